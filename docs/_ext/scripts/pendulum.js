// A double pendulum that is dragged and swings, and beside it the bowl of S over all accelerations.
const rod = 0.5, pivot = [180, 130], scale = 125, middle = [200, 120], wide = [1.5, 0.5];
let q = [-0.9, 0.8], v = [1, -2];
// M a = R: no motor acts.
const accelerations = (q, v) => { const [mass, rest] = mass_matrix_and_residual(q, v); return solve(rows(mass, 2), rest); };
const slope = x => [x[2], x[3], ...accelerations(x.slice(0, 2), x.slice(2))];
const places = () => {
  const elbow = polar(pivot, scale * rod, q[0]);
  return [pivot, elbow, polar(elbow, scale * rod, q[0] + q[1])];
};
const rest = (...angles) => { q = angles; v = [0, 0]; draw(); };
const heldByElbow = grip("elbow", () => places()[1], (x, y) => {
  const first = Math.atan2(pivot[1] - y, x - pivot[0]);
  rest(first, q[0] + q[1] - first);
});
const heldByEnd = grip("end", () => places()[2], (x, y) =>
  rest(...reached([x - pivot[0], pivot[1] - y].map(x => x / scale), rod, q[1])));
const advance = seconds => {
  if (heldByElbow() || heldByEnd()) return;
  for (let k = 0, n = Math.ceil(seconds / 0.002); k < n; k++) {
    const x = runge_kutta(slope, [...q, ...v], seconds / n);
    [q, v] = [x.slice(0, 2), x.slice(2)];
  }
};
const draw = () => {
  const point = values(), real = accelerations(q, v), [start, elbow, end] = places();
  const mass = rows(mass_matrix_and_residual(q, v)[0], 2), energy = kinetic_energy(q, v)[0] + potential_energy(q)[0];
  set("rods", {d: path([start, elbow, end])});
  set("elbow", {cx: elbow[0], cy: elbow[1]});
  set("end", {cx: end[0], cy: end[1]});
  const [x1, y1, turn1, x2, y2, turn2] = needs(...q, ...v, ...real);
  [[start, elbow, x1, y1, turn1, q[0]], [elbow, end, x2, y2, turn2, q[0] + q[1]]].forEach(([joint, far, x, y, turn, angle], k) => {
    const centre = joint.map((one, i) => (one + far[i]) / 2), round = Math.max(Math.min(1.2 * turn, 5), -5);
    set(`force-${k + 1}`, {d: path([centre, [centre[0] + 7 * x, centre[1] - 7 * y]])});
    set(`moment-${k + 1}`, {d: arc(joint, 24, angle, round), opacity: Math.abs(round) < 0.15 ? 0 : 1});
  });
  write("energy", `energy ${energy.toFixed(3)} J`);
  const on = (x, y) => [middle[0] + wide[0] * x, middle[1] - wide[1] * y];
  // On the line of height h, half of d · M d is h; M is L times its transpose.
  const [[a, b], [, c]] = mass, low = b / Math.sqrt(a), last = Math.sqrt(c - low * low);
  const ring = h => path([...Array(61).keys()].map(k => {
    const y = Math.sin(k * Math.PI / 30) / last, x = (Math.cos(k * Math.PI / 30) - low * y) / Math.sqrt(a);
    return on(real[0] + Math.sqrt(2 * h) * x, real[1] + Math.sqrt(2 * h) * y);
  }));
  set("bowl", {d: [4, 16, 64, 256, 1024, 4096].map(ring).join("")});
  const lowest = on(...real), dot = on(...point);
  set("lowest", {cx: lowest[0], cy: lowest[1]});
  set("dot", {cx: dot[0], cy: dot[1]});
  const off = point.map((x, k) => x - real[k]), by = times(mass, off);
  by.forEach((one, k) => {
    set(`bar-${k + 1}`, {d: `M255 ${257 + 24 * k}h${Math.max(Math.min(6 * one, 100), -100)}`});
    write(`by-${k + 1}`, `∂S/∂θ̈${"₁₂"[k]} = ${one.toFixed(2)} N m`);
  });
  write("height", `${((off[0] * by[0] + off[1] * by[1]) / 2).toFixed(1)} N m rad/s² above the lowest point`);
  Object.assign(figure.dataset, {q: JSON.stringify(q), v: JSON.stringify(v), energy});
};
onSliders(draw);
draw();
play(advance, draw);
