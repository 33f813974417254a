// A base arm with two rods moves in a given way. A first sweep carries ω, ω̇ and r̈ outwards, a second forces inwards.
const lines = [...figure.querySelectorAll(".formula")], on = ([x, y]) => [115 + 150 * x, 110 - 150 * y];
const names = ["base arm", "rod 1", "rod 2"], show = (key, values, shown) => set(key, {...values, opacity: shown ? 1 : 0});
const two = (x, y) => `(${x.toFixed(1)}, ${y.toFixed(1)})`;
const draw = () => {
  const [asked, time] = values(), stage = Math.round(asked), outwards = stage < 4, at = outwards ? stage - 1 : 6 - stage;
  const items = rows(motion(time), 13);
  items.forEach(([x, y, far_x, far_y, omega, , a_x, a_y, s_x, s_y, , all_x, all_y], k) => {
    const joint = on([x, y]), far = on([far_x, far_y]), middle = joint.map((one, i) => (one + far[i]) / 2);
    const arrow = (from, x, y, unit) => ({d: path([from, [from[0] + unit * x, from[1] - unit * y]])});
    const turn = Math.max(Math.min(0.9 * omega, 5), -5), known = !outwards || k <= at;
    set(`item-${k}`, {d: path([joint, far]), stroke: k === at ? "#e69f00" : "#999"});
    show(`acceleration-${k}`, arrow(joint, a_x, a_y, 4), known);
    show(`omega-${k}`, {d: arc(middle, 18, Math.PI / 2, turn)}, known && Math.abs(turn) > 0.15);
    show(`needs-${k}`, arrow(middle, s_x, s_y, 6), !outwards);
    show(`arrives-${k}`, arrow(joint, all_x, all_y, 6), !outwards && k >= at);
  });
  const [, , , , omega, domega, a_x, a_y, , , moment, all_x, all_y] = items[at];
  write("said", outwards ? `outwards, ${names[at]}` : `inwards, joint of ${names[at]}`);
  write("numbers", outwards ?
    `ω = ${omega.toFixed(2)} rad/s, ω̇ = ${domega.toFixed(1)} rad/s², r̈ = ${two(a_x, a_y)} m/s²` :
    `force ${two(all_x, all_y)} N, moment ${moment.toFixed(2)} N m`);
  lines.forEach((line, k) => { line.style.background = (k < 3) === outwards ? "#e69f0055" : ""; });
  Object.assign(figure.dataset, {stage, time, items: JSON.stringify(items)});
};
const advance = seconds => {
  inputs[0].value = 0.5 + (+inputs[0].value - 0.5 + seconds / 1.5) % 5.99;
  inputs[1].value = (+inputs[1].value + seconds / 5) % 20;
};
onSliders(draw);
draw();
play(advance, draw);
