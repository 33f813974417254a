// One error under a law that is called every h, acts T later, through motors with a lag, and the roots of this loop. `law`
// and `moved` are the notebook's.
// What is far outside of the frames, which clip it, need not be drawn as far.
const tick = 0.001, near = x => Math.max(Math.min(x, 99), -99);
const on = (t, e) => [40 + 100 * t, 120 - 90 * near(e)], round = (e, rate) => [140 + 90 * near(e), 120 - 18 * near(rate)];
const ones = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], transposed = rows => rows[0].map((_, k) => rows.map(row => row[k]));
// The polynomial of the loop from call to call, highest power first: of x⁺ = A x + now u(k − d) + old u(k − d − 1), u = law(x).
const polynomial = (h, late, lag) => {
  const d = Math.floor(late / h + 1e-9), rest = Math.max(late - d * h, 0);
  const A = transposed(ones.map(x => moved(...x, 0, lag, h))), K = ones.map(x => law(...x)[0]);
  const now = moved(0, 0, 0, 1, lag, h - rest), old = moved(...moved(0, 0, 0, 1, lag, rest), 0, lag, h - rest);
  // det(z − A) and adj(z − A), by Faddeev and Leverrier.
  const adjoint = [ones], determinant = [1];
  for (let k = 1; k <= 3; k++) {
    const next = transposed(transposed(adjoint.at(-1)).map(column => times(A, column)));
    determinant.push(-next.reduce((sum, row, i) => sum + row[i], 0) / k);
    adjoint.push(next.map((row, i) => row.map((x, j) => x + (i === j) * determinant[k])));
  }
  const through = b => adjoint.slice(0, 3).map(N => times([K], times(N, b))[0]);
  const [by_now, by_old] = [[...through(now), 0], [0, ...through(old)]], all = [...determinant, ...Array(d + 1).fill(0)];
  by_now.forEach((x, k) => { all[d + 1 + k] -= x + by_old[k]; });
  return all;
};
// All roots at once, each pushed away by the others (Durand and Kerner); pairs of real and imaginary part.
const product = ([a, b], [x, y]) => [a * x - b * y, a * y + b * x];
const quotient = ([a, b], [x, y]) => [(a * x + b * y) / (x * x + y * y), (b * x - a * y) / (x * x + y * y)];
const roots = all => {
  const found = all.slice(1).map((_, k) => [Math.cos(0.4 + 2 * Math.PI * k / (all.length - 1)), Math.sin(0.4 + 2 * Math.PI * k / (all.length - 1))]);
  for (let round = 0, most = 1; round < 300 && most > 1e-13; round++) {
    most = 0;
    found.forEach((z, k) => {
      const value = all.reduce((sum, x) => { const [a, b] = product(sum, z); return [a + x, b]; }, [0, 0]);
      const others = found.reduce((all, x, i) => i === k ? all : product(all, [z[0] - x[0], z[1] - x[1]]), [1, 0]);
      const [a, b] = quotient(value, others);
      found[k] = [z[0] - a, z[1] - b];
      most = Math.max(most, Math.hypot(a, b));
    });
  }
  return found;
};
const draw = () => {
  const [h, late, lag] = values(), waiting = [], over_time = [], plane = [], tops = [0, 0, 0, 0, 0];
  let state = [1, 0, 0], acts = 0, calls = 0;
  for (let k = 0; k <= 8000; k++) {
    const t = k * tick;
    if (t >= calls * h - tick / 2) waiting.push([calls++ * h + late, law(...state)[0]]);
    while (waiting.length && waiting[0][0] <= t + tick / 2) acts = waiting.shift()[1];
    if (k % 10 === 0 && k <= 3000) { over_time.push(on(t, state[0])); plane.push(round(...state)); }
    const of_time = Math.floor(t / 2);
    tops[of_time] = Math.max(tops[of_time], Math.hypot(state[0], state[1] / 5));
    state = moved(...state, acts, lag, tick);
  }
  // As exponents: a root z at every call is s = ln z / h.
  const exponents = roots(polynomial(h, late, lag)).map(([a, b]) => [Math.log(Math.hypot(a, b)) / h, Math.atan2(b, a) / h]);
  const slowest = Math.max(...exponents.map(([a]) => a));
  set("roots", {d: exponents.filter(([a, b]) => a > -25 && a < 8 && Math.abs(b) < 24).map(([a, b]) =>
    [b, -b].map(b => `M${(220 + 8 * a).toFixed(1)} ${(125 - 4.6 * b).toFixed(1)}h0`).join("")).join("")});
  write("slowest", `slowest root: ${slowest.toFixed(2)}/s`);
  set("response", {d: path(over_time)});
  set("plane", {d: path(plane)});
  // What is largest in two seconds tells better than an instant whether an oscillation grows.
  const growth = tops[3] / tops[2];
  write("left", growth < 1 ? `dies away: after 8 s ${tops[4].toExponential(0)} is left` : "grows");
  Object.assign(figure.dataset, {growth, slowest});
};
onSliders(draw);
draw();
