// The hybrid system I_H x = R_H + B_H u moves the robot, and its entries are what the arrays show.
const size = known.unknowns.length, held = known.unknowns.map((_, i) => i).filter(i => !known.free.includes(i));
const torques = held.slice(held.length / 2), above = size - torques.length;
let q = [0, 0, 0, 0.4, -0.4, -2.1, 0, 0, 0], v, time = 0, chosen = "I 7 11";
// The motion that is asked for: at any time its posture, velocities and accelerations.
const swing = [0.15, 0.15, 0.3, 0.8, 0.3, 0.5, 0.3, 0.3, 0.3], pace = [0.9, 0.7, 0.5, 0.6, 0.8, 1.1, 0.5, 0.6, 0.7];
const start = q, asked = t => [
  start.map((x, i) => x + swing[i] * Math.sin(pace[i] * t)),
  start.map((_, i) => swing[i] * pace[i] * Math.cos(pace[i] * t)),
  start.map((_, i) => -swing[i] * pace[i] ** 2 * Math.sin(pace[i] * t)),
];
v = asked(0)[1];
const arrays = () => ({I: rows(hybrid_mass_matrix(q), size), R: rows(hybrid_residual(q, v), 1),
  B: rows(hybrid_input_matrix(q), known.acting.length)});

const advance = seconds => {
  for (let left = seconds; left > 1e-9; left -= 0.004) {
    const h = Math.min(left, 0.004), {I, R, B} = arrays(), [q_d, v_d, a_d] = asked(time);
    const wanted = Array(size).fill(0);
    known.free.forEach((row, i) => { wanted[row] = a_d[i] + 10 * (v_d[i] - v[i]) + 25 * (q_d[i] - q[i]); });
    // Inputs and constraint torques for these accelerations, by the rows above the constraints.
    const needed = times(I, wanted).map((x, i) => x - R[i][0]).slice(0, above);
    const inputs = solve(B.slice(0, above).map((row, i) => [...row, ...torques.map(k => -I[i][k])]), needed);
    const found = solve(I, R.map(([x], i) => x + times([B[i]], inputs)[0]));
    v = v.map((x, i) => x + h * found[known.free[i]]);
    q = q.map((x, i) => x + h * v[i]);
    time += h;
  }
};

const index = text => text.replaceAll("-", "−").replace(/_\{([^}]*)\}|_(\w)/g, (_, long, short) => `<sub>${long ?? short}</sub>`);
const list = names => names.length < 2 ? `arm ${names}` : `arms ${names.slice(0, -1).join(", ")} and ${names.at(-1)}`;
const unitOf = (letter, row, column) => {
  const turns = [known.units[row] !== "m", known.units[column] !== "m"];
  if (letter === "I") return turns[0] && turns[1] ? "kg m²" : turns[0] || turns[1] ? "kg m" : "kg";
  return letter === "R" ? turns[0] ? "N m" : "N" : turns[0] && column < known.arms.length - 3 ? "N m for each N" : "";
};
let unit = "";
const choose = key => {
  const [letter, row, column] = key.split(" ").map((x, k) => k ? +x : x);
  const made = known.parts[key] ?? known.parts[`${letter} ${column} ${row}`] ?? [];
  const name = index(known.unknowns[row]), other = index(letter === "B" ? known.acting[column] : known.unknowns[column]);
  chosen = key;
  figure.querySelectorAll("[data-at]").forEach(cell => {
    const here = cell.dataset.at === key;
    cell.setAttribute("aria-selected", here);
    cell.tabIndex = here ? 0 : -1;
  });
  const edge = !made.length, torque = Math.max(row, column);
  unit = edge ? "" : unitOf(letter, row, column);
  part("entry").innerHTML = edge ? `<b>I<sub>H</sub></b>, row of ${name}, column of ${other}: ${row < column ?
    "the constraint torque acts in the row of the joint that it holds" : "the joint that is held does not accelerate (eq. 14)"}` :
    letter === "I" ? `<b>I<sub>H</sub></b>, row of ${name}, column of ${other}: what ${other} = 1 needs in the row of ${name}` :
    letter === "R" ? `<b>R<sub>H</sub></b>, row of ${name}: rates and weight` :
    `<b>B<sub>H</sub></b>, row of ${name}, column of ${other}: what 1 ${column < known.arms.length - 3 ? "N" : "N m"} of ${other} does there`;
  part("terms").innerHTML = made.map(([chain, item, text, arms]) => {
    const letters = Object.entries(known.letters[chain - 1]).filter(([name]) => text.includes(name));
    const where = letters.map(([name, value]) => `${index(name)} = ${index(value)}`).join(", ");
    return `<p style="margin:.3em 0"><b style="color:${known.colours[chain - 1]}">chain ${chain}</b>${arms.length ?
      `, mass of ${list(arms)}` : ""}: ${letter === "B" ? "" : `${index(item)} = `}${index(text)}${where ? `, with ${where}` : ""}</p>`;
  }).join("");
  const coloured = {};
  made.forEach(([chain, , , arms]) => arms.forEach(arm => { coloured[arm] = known.colours[chain - 1]; }));
  if (letter === "B") coloured[column + 1] = known.colours[made[0][0] - 1];
  if (edge) coloured[torques.indexOf(torque) + 2] = known.colours[torques.indexOf(torque)];
  known.arms.forEach((_, k) => set(`arm-${k + 1}`, {stroke: coloured[k + 1] ?? "currentColor",
    "stroke-width": coloured[k + 1] ? 4 : 1.5, opacity: coloured[k + 1] ? 1 : 0.45}));
  draw();
};
const draw = () => {
  const [letter, row, column] = chosen.split(" ");
  const value = arrays()[letter][row][column], places = rows(positions(q), 3);
  const on = point => times(known.view, places[known.points.indexOf(point)]).map((x, k) => k ? 62 - 38 * x : 52 + 38 * x);
  known.arms.forEach((ends, k) => set(`arm-${k + 1}`, {d: path(ends.map(on))}));
  Object.assign(figure.dataset, {q: JSON.stringify(q), v: JSON.stringify(v), value});
  write("value", `now ${Math.abs(value) < 1e-12 ? 0 : value.toPrecision(5)} ${unit}`);
};
const cells = [...figure.querySelectorAll("[data-at]")];
cells.forEach(cell => {
  const [letter, row, column] = cell.dataset.at.split(" ");
  cell.ariaLabel = `row ${known.unknowns[row]}, column ${letter === "R" ? "R" : letter === "B" ? known.acting[column] : known.unknowns[column]}`;
  if (letter === "I" && !known.parts[cell.dataset.at] && !known.parts[`I ${column} ${row}`]) cell.textContent = +row < +column ? "−1" : "1";
  ["click", "focus"].forEach(event => cell.addEventListener(event, () => choose(cell.dataset.at)));
  cell.addEventListener("keydown", event => {
    const way = {ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0]}[event.key];
    if (!way) return;
    event.preventDefault();
    // The next entry that way which is not blank.
    for (let k = 1; k < size; k++) {
      const next = cells.find(one => one.dataset.at === `${letter} ${+row + k * way[0]} ${+column + k * way[1]}`);
      if (next) return next.focus();
    }
  });
});
choose(chosen);
play(advance, draw);
