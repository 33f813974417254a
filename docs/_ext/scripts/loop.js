// The double pendulum under computed torque that is called every h, acts T later, through motors with a lag.
const rod = 0.5, pivot = [180, 150], scale = 125, tick = 0.001, on_time = (t, e) => [330 + 100 * t, 90 - 60 * Math.max(Math.min(e, 1.3), -1.3)];
const start = [-1.4, 0.9];
let q = start, v = [0, 0], target = [-0.5, -0.9], torque, acts, time = 0, next = 0, waiting = [], errors = [];
const wanted = () => inverse_dynamics(q, v, q.map((x, i) => -10 * v[i] + 25 * (target[i] - x)));
torque = acts = wanted();
const advance = seconds => {
  const [h, late, lag] = values();
  for (let k = 0, n = Math.round(seconds / tick); k < n; k++) {
    if (time >= next - tick / 2) {
      waiting.push([time + late, wanted()]);
      next = time + h;
    }
    while (waiting.length && waiting[0][0] <= time + tick / 2) acts = waiting.shift()[1];
    const left = Math.exp(-tick / lag);
    // What acts on average over the step.
    const mean = torque.map((x, i) => acts[i] + (x - acts[i]) * (1 - left) * lag / tick);
    torque = torque.map((x, i) => acts[i] + (x - acts[i]) * left);
    const x = runge_kutta(x => [x[2], x[3], ...forward_dynamics(x.slice(0, 2), x.slice(2), mean)], [...q, ...v], tick);
    [q, v] = [x.slice(0, 2), x.slice(2)];
    time += tick;
    if (Math.round(time / tick) % 20 === 0) errors = [...errors.slice(-150), [time, ...q.map((x, i) => target[i] - x)]];
  }
  if (!(Math.hypot(...v) < 60)) {  // Lost: it begins anew.
    [q, v, waiting, errors] = [start, [0, 0], [], []];
    torque = acts = wanted();
  }
};
const places = angles => {
  const elbow = polar(pivot, scale * rod, angles[0]);
  return [pivot, elbow, polar(elbow, scale * rod, angles[0] + angles[1])];
};
grip("target", () => places(target)[2], (x, y) => {
  target = reached([x - pivot[0], pivot[1] - y].map(x => x / scale), rod, target[1]);
  draw();
});
const draw = () => {
  values();  // Beside the sliders, while time stands still too.
  const rods = places(q), asked = places(target);
  set("rods", {d: path(rods)});
  set("asked", {d: path(asked)});
  set("target", {cx: asked[2][0], cy: asked[2][1]});
  torque.forEach((x, k) => {
    const turn = Math.max(Math.min(x / 2, 5), -5);
    set(`torque-${k + 1}`, {d: arc(rods[k], 26, k ? q[0] + q[1] : q[0], turn), opacity: Math.abs(turn) < 0.15 ? 0 : 1});
    set(`error-${k + 1}`, {d: errors.length ? path(errors.map(one => on_time(one[0] - time, one[k + 1]))) : ""});
  });
  write("numbers", `torques ${torque.map(x => x.toFixed(1)).join(" and ")} N m`);
  Object.assign(figure.dataset, {q: JSON.stringify(q), v: JSON.stringify(v), target: JSON.stringify(target), torque: JSON.stringify(torque)});
};
onSliders(draw);
draw();
play(advance, draw);
