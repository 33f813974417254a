// Chaplygin's sleigh, of the rows and columns of the planar base that remain, and beside it one without their terms.
const kept = [0, 2], whole = ([u, turn]) => [u, 0, turn], centre = [190, 150], scale = 60, spring = 3;
let right, wrong, trail, pulled;
const place = q => [q[0] + ahead * Math.cos(q[2]), q[1] + ahead * Math.sin(q[2])];
const accelerations = (q, v, force) => {
  const [mass, rest] = mass_matrix_and_residual(q, whole(v)), all = rows(mass, 3);
  const along = force[0] * Math.cos(q[2]) + force[1] * Math.sin(q[2]);
  const across = force[1] * Math.cos(q[2]) - force[0] * Math.sin(q[2]);
  const pushed = [along, 0, ahead * across];
  return solve(kept.map(i => kept.map(j => all[i][j])), kept.map(i => rest[i] + pushed[i]));
};
const moved = (x, h, rates) => runge_kutta(
  x => [...coordinate_rates(x.slice(0, 3), whole(x.slice(3))), ...rates(x.slice(0, 3), x.slice(3))], x, h);
const begin = () => {
  right = [0, 0, 0, ...values()];
  wrong = right;
  trail = [[], []];
  pulled = null;
};
const on = (x, y) => [centre[0] + scale * (x - right[0]), centre[1] - scale * (y - right[1])];
const held = grip("mass", () => on(...place(right)), (x, y) => {
  pulled = [right[0] + (x - centre[0]) / scale, right[1] - (y - centre[1]) / scale];
  // By the keyboard it is pushed: a tenth of a second of the pull.
  if (!held()) { advance(0.1, true); draw(); }
});
const advance = (seconds, pulls = held()) => {
  const by = q => pulls ? place(q).map((x, k) => spring * (pulled[k] - x)) : [0, 0];
  for (let k = 0, n = Math.ceil(seconds / 0.005); k < n; k++) {
    right = moved(right, seconds / n, (q, v) => accelerations(q, v, by(q)));
    // What the wrong equations do begins where the hand lets go.
    wrong = pulls ? right : moved(wrong, seconds / n, () => [0, 0]);
  }
  if (pulls) trail = [[], []];
  [right, wrong].forEach((x, k) => { trail[k] = [...trail[k].slice(-400), x.slice(0, 2)]; });
};
const drawn = (name, x) => {
  const [c, s] = [Math.cos(x[2]), Math.sin(x[2])], at = (a, b) => on(x[0] + a * c - b * s, x[1] + a * s + b * c);
  const body = [[-0.25, 0.3], [0.6, 0.3], [0.6, -0.3], [-0.25, -0.3], [-0.25, 0.3]].map(corner => at(...corner));
  const wheels = [0.36, -0.36].map(b => path([at(-0.17, b), at(0.17, b)]));
  set(name, {d: path(body) + wheels.join("")});
};
const draw = () => {
  const [, , , u, turn] = right, [x, y] = on(...place(right));
  drawn("right", right);
  drawn("wrong", wrong);
  set("mass", {cx: x, cy: y});
  set("band", {d: held() ? path([[x, y], on(...pulled)]) : ""});
  trail.forEach((way, k) => set(["way", "astray"][k], {d: way.length ? path(way.map(at => on(...at))) : ""}));
  const first = centre.map((x, k) => x % scale - scale * (k ? -right[1] % 1 : right[0] % 1));
  set("grid", {d: [...Array(9).keys()].map(k => `M${first[0] + scale * (k - 1)} 0V300M0 ${Math.min(first[1] + scale * (k - 1), 300)}H380`).join("")});
  const energy = kinetic_energy(right.slice(0, 3), whole([u, turn]))[0];
  write("numbers", `u ${u.toFixed(2)} m/s, ω ${turn.toFixed(2)} rad/s, energy ${energy.toFixed(3)} J`);
  Object.assign(figure.dataset, {right: JSON.stringify(right), wrong: JSON.stringify(wrong), energy});
};
onSliders(() => { begin(); draw(); });
begin();
draw();
play(advance, draw);
