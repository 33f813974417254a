// A slider chooses one of the drawings that were computed: paths and words by the class of their part.
const draw = () => {
  const at = Math.round(values()[0] - inputs[0].min), {d, words} = frames[at];
  Object.entries(d).forEach(([key, line]) => set(key, {d: line}));
  Object.entries(words).forEach(([key, text]) => write(key, text));
  figure.dataset.frame = at;
};
onSliders(draw);
draw();
