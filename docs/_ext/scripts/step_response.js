// One error under a law that is called every h, acts T later, through motors with a lag; both functions are the notebook's.
const tick = 0.001, on = (t, e) => [40 + 100 * t, 120 - 90 * Math.max(Math.min(e, 1.25), -1.25)];
const round = (e, rate) => [560 + 90 * Math.max(Math.min(e, 1.2), -1.2), 120 - 18 * Math.max(Math.min(rate, 6), -6)];
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
  set("response", {d: path(over_time)});
  set("plane", {d: path(plane)});
  // What is largest in two seconds tells better than an instant whether an oscillation grows.
  const growth = tops[3] / tops[2];
  write("left", growth < 1 ? `dies away: after 8 s ${tops[4].toExponential(0)} is left` : "grows");
  figure.dataset.growth = growth;
};
onSliders(draw);
draw();
