// A slider chooses one of the drawings that were computed: paths and words by the class of their part.
const draw = () => {
  const [value] = values(), [low, high] = [+inputs[0].min, +inputs[0].max];
  const at = Math.round((value - low) / (high - low) * (frames.length - 1)), {d, words} = frames[at];
  Object.entries(d).forEach(([key, line]) => set(key, {d: line}));
  Object.entries(words).forEach(([key, text]) => write(key, text));
  figure.dataset.frame = at;
};
const advance = seconds => {
  const {min, max, value} = inputs[0];
  inputs[0].value = +min + (value - min + pace * seconds) % (max - min);
};
onSliders(draw);
draw();
if (pace) play(advance, draw);
