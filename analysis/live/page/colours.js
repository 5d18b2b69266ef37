// Colours: viridis for numbers, as the terminal has it, and those of the style sheet for all else.

const VIRIDIS = [
  [68, 1, 84], [71, 44, 122], [59, 81, 139], [44, 113, 142], [33, 144, 141], [39, 173, 129], [92, 200, 99],
  [170, 220, 50], [253, 231, 37],
];
const LINES_ON_LIGHT = [0, 0.62], LINES_ON_DARK = [0.34, 1];
const THEME_NAMES = ["ink", "soft", "line", "card", "bar", "mark", "true"];

/** Red, green and blue of a number from 0 to 1. */
export function viridis(value) {
  const at = Math.min(1, Math.max(0, value)) * (VIRIDIS.length - 1);
  const low = Math.min(Math.floor(at), VIRIDIS.length - 2);
  return VIRIDIS[low].map((from, i) => Math.round(from + (at - low) * (VIRIDIS[low + 1][i] - from)));
}

/** The same as a colour of CSS. */
export function viridisColour(value) {
  return `rgb(${viridis(value).join(", ")})`;
}

/** The part of viridis that can be read as a line: without its yellow on a light ground, its violet on a dark one. */
export function lineRgb(value, theme) {
  const [low, high] = isLight(theme.card) ? LINES_ON_LIGHT : LINES_ON_DARK;
  return viridis(low + (high - low) * Math.min(1, Math.max(0, value)));
}

/** The same as a colour of CSS. */
export function lineColour(value, theme) {
  return `rgb(${lineRgb(value, theme).join(", ")})`;
}

function isLight(colour) {
  return inkOn(colour.match(/[\d.]+/g).map(Number)) === "#000";
}

/** Where a belief lies on the scale; the root makes small ones visible. */
export function beliefScale(belief) {
  return Math.sqrt(Math.min(1, Math.max(0, belief)));
}

/** Ink that can be read on a colour. */
export function inkOn([red, green, blue]) {
  return 0.299 * red + 0.587 * green + 0.114 * blue < 128 ? "#fff" : "#000";
}

/** Colours of the style sheet as they are now, light or dark. */
export function themeOf(element) {
  const probe = document.createElement("span");
  probe.hidden = true;
  element.append(probe);
  const theme = {};
  for (const name of THEME_NAMES) {
    probe.style.color = `var(--st-${name})`;
    theme[name] = getComputedStyle(probe).color;
  }
  probe.remove();
  return theme;
}
