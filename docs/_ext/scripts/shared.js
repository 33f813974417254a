// What drawings that move share. `figure` is the one that a script is in; parts of it are found by their class.
const part = key => figure.querySelector("." + key);
const set = (key, values) => Object.entries(values).forEach(([attribute, value]) =>
  part(key).setAttribute(attribute, value));
const write = (key, text) => part(key).replaceChildren(String(text).replaceAll("-", "−"));
const path = points => "M" + points.map(point => point.map(x => x.toFixed(1)).join(" ")).join("L");
const polar = ([x, y], radius, angle) => [x + radius * Math.cos(angle), y - radius * Math.sin(angle)];
// An arc with a tip; angles are counted as those of joints, against the clock.
const arc = (centre, radius, from, turn) =>
  path([...Array(25).keys()].map(k => polar(centre, radius, from + turn * k / 24)));

// Solutions of matrix · x = right: elimination with the largest pivot of each column.
const solve = (matrix, right) => {
  const rows = matrix.map((row, i) => [...row, right[i]]), size = rows.length;
  for (let k = 0; k < size; k++) {
    const best = rows.reduce((top, row, i) => i > k && Math.abs(row[k]) > Math.abs(rows[top][k]) ? i : top, k);
    [rows[k], rows[best]] = [rows[best], rows[k]];
    for (let i = k + 1; i < size; i++) {
      const factor = rows[i][k] / rows[k][k];
      if (factor) for (let j = k; j <= size; j++) rows[i][j] -= factor * rows[k][j];
    }
  }
  const found = Array(size);
  for (let i = size - 1; i >= 0; i--) {
    found[i] = rows[i].slice(i + 1, size).reduce((sum, x, j) => sum - x * found[i + 1 + j], rows[i][size]) / rows[i][i];
  }
  return found;
};
const rows = (flat, width) => Array.from({length: flat.length / width}, (_, i) => flat.slice(i * width, i * width + width));
const times = (matrix, vector) => matrix.map(row => row.reduce((sum, x, j) => sum + x * vector[j], 0));
// Angles of two rods of a length whose end is as near to a place as can be; the second has the sign of `side`.
const reached = ([x, y], rod, side) => {
  const far = Math.min(Math.hypot(x, y) / rod, 1.999);
  const second = Math.sign(side || 1) * Math.acos(Math.max(far * far / 2 - 1, -0.999));
  return [Math.atan2(y, x) - second / 2, second];
};
// A step h in time by Runge and Kutta's rule of fourth order.
const runge_kutta = (slope, x, h) => {
  const moved = (k, h) => x.map((one, i) => one + h * k[i]);
  const a = slope(x), b = slope(moved(a, h / 2)), c = slope(moved(b, h / 2)), d = slope(moved(c, h));
  return moved(a.map((one, i) => (one + 2 * b[i] + 2 * c[i] + d[i]) / 6), h);
};

// Sliders, whose values stand beside them; draw is given all of them.
const inputs = [...figure.querySelectorAll("input")];
const values = () => inputs.map(one => {
  one.nextElementSibling.value = (+one.value).toFixed(+one.dataset.digits).replace("-", "−");
  return +one.value;
});
const onSliders = draw => inputs.forEach(one => one.addEventListener("input", draw));

// A part that is dragged, or moved by the arrow keys: place() is where it is, moved(x, y) where it is to be.
const grip = (key, place, moved) => {
  const one = part(key), steps = {ArrowLeft: [-9, 0], ArrowRight: [9, 0], ArrowUp: [0, -9], ArrowDown: [0, 9]};
  let held = false;
  const follow = event => {
    const {x, y} = new DOMPoint(event.clientX, event.clientY).matrixTransform(one.ownerSVGElement.getScreenCTM().inverse());
    moved(x, y);
  };
  one.addEventListener("pointerdown", event => { held = true; one.setPointerCapture(event.pointerId); follow(event); });
  one.addEventListener("pointermove", event => held && follow(event));
  ["pointerup", "pointercancel"].forEach(end => one.addEventListener(end, () => { held = false; }));
  one.addEventListener("keydown", event => {
    const step = steps[event.key];
    if (step) { event.preventDefault(); moved(...place().map((x, k) => x + step[k])); }
  });
  return () => held;
};

// The button lets time pass, and stops it. Time passes by itself while the figure is in view, unless the reader
// wants no motion. figure.advance lets seconds pass at once.
const play = (advance, draw) => {
  const button = part("play");
  let runs = !matchMedia("(prefers-reduced-motion: reduce)").matches, seen = false, last = 0;
  const say = () => { button.textContent = runs ? "stop" : "let it move"; };
  button.addEventListener("click", () => { runs = !runs; say(); });
  figure.advance = seconds => { advance(seconds); draw(); };
  const frame = now => {
    const passed = Math.min((now - last) / 1000, 0.04);
    last = now;
    if (runs && seen && passed > 0) figure.advance(passed);
    requestAnimationFrame(frame);
  };
  new IntersectionObserver(([entry]) => { seen = entry.isIntersecting; }).observe(figure);
  say();
  requestAnimationFrame(frame);
};
part("controls").hidden = false;
