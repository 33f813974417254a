// The hybrid system I_H x = R_H + B_H u moves the robot, and its entries are what the arrays show.
const size = known.unknowns.length, held = known.unknowns.map((_, i) => i).filter(i => !known.free.includes(i));
const torques = held.slice(held.length / 2), above = size - torques.length;
// Values of attitude and joints, and those of further joints and of the position.
const by = (values, further) => known.free.map((_, i) => (i < known.free.length - 3 ? values[i] : undefined) ?? further(i));
let q = by([0, 0, 0, 0.4, -0.4, -2.1], () => 0), v, time = 0;
let chosen = `I ${held[torques.length - 1]} ${known.free.at(-3)}`;
// The motion that is asked for: at any time its posture, velocities and accelerations.
const swing = by([0.15, 0.15, 0.3, 0.8, 0.3, 0.5], () => 0.3), pace = by([0.9, 0.7, 0.5, 0.6, 0.8, 1.1], i => 0.5 + 0.1 * (i % 3));
const start = q, asked = t => [
  start.map((x, i) => x + swing[i] * Math.sin(pace[i] * t)),
  start.map((_, i) => swing[i] * pace[i] * Math.cos(pace[i] * t)),
  start.map((_, i) => -swing[i] * pace[i] ** 2 * Math.sin(pace[i] * t)),
];
v = asked(0)[1];
const arrays = () => ({I: rows(hybrid_mass_matrix(q), size), R: rows(hybrid_residual(q, v), 1),
  B: rows(hybrid_input_matrix(q), known.acting.length)});

// All unknowns, under the inputs for the motion that is asked for.
const solution = () => {
  const {I, R, B} = arrays(), [q_d, v_d, a_d] = asked(time), wanted = Array(size).fill(0);
  known.free.forEach((row, i) => { wanted[row] = a_d[i] + 10 * (v_d[i] - v[i]) + 25 * (q_d[i] - q[i]); });
  // Inputs and constraint torques for these accelerations, by the rows above the constraints.
  const needed = times(I, wanted).map((x, i) => x - R[i][0]).slice(0, above);
  const inputs = solve(B.slice(0, above).map((row, i) => [...row, ...torques.map(k => -I[i][k])]), needed);
  return solve(I, R.map(([x], i) => x + times([B[i]], inputs)[0]));
};
const advance = seconds => {
  for (let left = seconds; left > 1e-9; left -= 0.004) {
    const h = Math.min(left, 0.004), found = solution();
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
  return letter === "R" ? turns[0] ? "N m" : "N" : turns[0] && column < known.thrusts ? "N m for each N" : "";
};
const onEdge = key => key[0] === "I" && key.split(" ").some(place => place >= above);
const cells = [...figure.querySelectorAll("[data-at]")];
// The cell of each array to which the tabulator leads.
const stops = Object.fromEntries(["R", "B"].map(letter => [letter, cells.find(cell => cell.dataset.at[0] === letter).dataset.at]));
let unit = "";
const choose = key => {
  const [letter, row, column] = key.split(" ").map((x, k) => k ? +x : x);
  const made = known.parts[key] ?? known.parts[`${letter} ${column} ${row}`] ?? [];
  const name = index(known.unknowns[row]), other = index(letter === "B" ? known.acting[column] : known.unknowns[column]);
  chosen = stops[letter] = key;
  cells.forEach(cell => {
    cell.setAttribute("aria-selected", cell.dataset.at === key);
    cell.tabIndex = Object.values(stops).includes(cell.dataset.at) ? 0 : -1;
  });
  const edge = onEdge(key), torque = Math.max(row, column);
  unit = edge ? "" : unitOf(letter, row, column);
  part("entry").innerHTML = edge ? `<b>I<sub>H</sub></b>, row of ${name}, column of ${other}: ${row < column ?
    "the constraint torque acts in the row of the joint that it holds" : "the joint that is held does not accelerate (eq. 14)"}` :
    letter === "I" ? `<b>I<sub>H</sub></b>, row of ${name}, column of ${other}: what ${other} = 1 needs in the row of ${name}` :
    letter === "R" ? `<b>R<sub>H</sub></b>, row of ${name}: rates and weight` :
    `<b>B<sub>H</sub></b>, row of ${name}, column of ${other}: what 1 ${column < known.thrusts ? "N" : "N m"} of ${other} does there`;
  part("terms").innerHTML = made.map(([chain, item, text, arms]) => {
    const letters = Object.entries(known.letters[chain - 1]).filter(([name]) => text.includes(name));
    const where = letters.map(([name, value]) => `${index(name)} = ${index(value)}`).join(", ");
    return `<p style="margin:.3em 0"><b style="color:${known.colours[chain - 1]}">chain ${chain}</b>${arms.length ?
      `, mass of ${list(arms)}` : letter !== "B" ? "" : `, ${column < known.thrusts ? "rotor" : "joint"} of arm ${column + 1}`}: ${letter === "B" ? "" : `${index(item)} = `}${index(text)}${where ? `, with ${where}` : ""}</p>`;
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
  const found = solution(), held_by = torques.map(k => found[k]);
  // The base from above; 1 rad of an arc is 3 N m.
  held_by.forEach((torque, k) => {
    const turn = Math.max(Math.min(torque / 3, 5), -5);
    set(`torque-${k + 2}`, {d: arc([90, 255], 28 + 7 * k, known.angles[k + 1], turn), opacity: Math.abs(turn) < 0.1 ? 0 : 1});
  });
  part("torques").innerHTML = `constraint torques ${held_by.map((x, k) =>
    `<span style="color:${known.colours[k]}">${index(known.unknowns[torques[k]])} = ${(Math.round(10 * x) / 10 + 0).toFixed(1)}</span>`).join(", ")} N m`.replaceAll("= -", "= −");
  Object.assign(figure.dataset, {q: JSON.stringify(q), v: JSON.stringify(v), value, found: JSON.stringify(found)});
  write("value", `now ${Math.abs(value) < 1e-12 ? 0 : value.toPrecision(5)} ${unit}`);
};
cells.forEach(cell => {
  const [letter, row, column] = cell.dataset.at.split(" ");
  cell.ariaLabel = `row ${known.unknowns[row]}, column ${letter === "R" ? "R" : letter === "B" ? known.acting[column] : known.unknowns[column]}`;
  if (onEdge(cell.dataset.at)) cell.textContent = +row < +column ? "−1" : "1";
  ["click", "focus"].forEach(event => cell.addEventListener(event, () => choose(cell.dataset.at)));
  cell.addEventListener("keydown", event => {
    const way = {ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0]}[event.key];
    if (!way) return;
    event.preventDefault();
    // The nearest entry that way, in the same line if there is one.
    const far = cells.map(one => {
      const [other, i, k] = one.dataset.at.split(" "), down = i - row, right = k - column;
      const along = down * way[0] + right * way[1], across = Math.abs(down * way[1] + right * way[0]);
      return other === letter && along > 0 ? along + size * across : Infinity;
    });
    const least = Math.min(...far);
    if (least < Infinity) cells[far.indexOf(least)].focus();
  });
});
choose(chosen);
play(advance, draw);
