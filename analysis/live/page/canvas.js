// What all pictures share: sharp canvases, text that fits, and axes.

const FONT = 'system-ui, "Segoe UI", Helvetica, Arial, sans-serif';

/** Drawing context of a canvas of this height in CSS pixels, cleared, with its width and height. */
export function surface(canvas, height, theme) {
  const width = Math.max(1, Math.round(canvas.clientWidth)), ratio = window.devicePixelRatio || 1;
  canvas.style.height = `${height}px`;
  const size = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.fillStyle = theme.ink;
  context.strokeStyle = theme.ink;
  context.lineWidth = 1;
  context.setLineDash([]);
  context.textBaseline = "middle";
  context.textAlign = "left";
  context.font = `12px ${FONT}`;
  return { context, width, height };
}

/** Sets the size of the font. */
export function fontSize(context, pixels, weight = 400) {
  context.font = `${weight} ${pixels}px ${FONT}`;
}

/** The text, with its end cut off where it is longer than the room. */
export function fitted(context, text, room) {
  if (text.length * 30 < room || context.measureText(text).width <= room) return text;
  let low = 0, high = Math.min(text.length, 200);
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (context.measureText(`${text.slice(0, middle)}…`).width <= room) low = middle;
    else high = middle - 1;
  }
  return low ? `${text.slice(0, low)}…` : "";
}

/** A straight line. */
export function stroke(context, x0, y0, x1, y1, colour, dash = [], width = 1) {
  context.save();
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.setLineDash(dash);
  context.beginPath();
  context.moveTo(x0, y0);
  context.lineTo(x1, y1);
  context.stroke();
  context.restore();
}

/** Round values within a range, about as many as asked for. */
export function ticks(low, high, count) {
  const span = high - low;
  if (!(span > 0)) return [low];
  const rough = span / Math.max(1, count), power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough * 0.999);
  const values = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * span; i += 1) values.push(i * step);
  return values;
}

/** A number as short as it is clear. */
export function brief(value, digits = 4) {
  const text = String(Number(value.toPrecision(digits)));
  return (text.length > 9 ? value.toExponential(1) : text).replace("-", "−");
}

/** The least of any number of values. */
export function least(values) {
  return values.reduce((a, b) => Math.min(a, b), Infinity);
}

/** The largest of any number of values. */
export function most(values) {
  return values.reduce((a, b) => Math.max(a, b), -Infinity);
}

/** Maps a range to another. */
export function scale(low, high, from, to) {
  const span = high - low || 1;
  return (value) => from + ((value - low) / span) * (to - from);
}

/** A frame with axes; returns the maps of both and the place of the plot. */
export function axes(context, box, xRange, yRange, theme, { xLabel, yLabel, whole = false, xNumbers = true }) {
  const [left, top, right, bottom] = box;
  const x = scale(xRange[0], xRange[1], left, right), y = scale(yRange[0], yRange[1], bottom, top);
  fontSize(context, 11);
  for (const value of ticks(yRange[0], yRange[1], Math.max(2, (bottom - top) / 32))) {
    stroke(context, left, y(value), right, y(value), theme.line, [], 0.5);
    context.fillStyle = theme.soft;
    context.textAlign = "right";
    context.fillText(brief(value), left - 4, y(value));
  }
  context.textAlign = "center";
  for (const value of ticks(xRange[0], xRange[1], Math.max(2, (right - left) / 60))) {
    if (whole && !Number.isInteger(value)) continue;
    stroke(context, x(value), bottom, x(value), bottom + 3, theme.soft);
    if (xNumbers) context.fillText(brief(value), x(value), bottom + 10);
  }
  stroke(context, left, bottom, right, bottom, theme.soft);
  context.fillStyle = theme.ink;
  if (xLabel) context.fillText(fitted(context, xLabel, right - left), (left + right) / 2, bottom + 25);
  if (yLabel) upright(context, yLabel, 8, (top + bottom) / 2, bottom - top + 16);
  return { x, y };
}

/** Text turned by a quarter, around a point. */
export function upright(context, text, x, y, room) {
  context.save();
  context.translate(x, y);
  context.rotate(-Math.PI / 2);
  context.textAlign = "center";
  context.fillText(fitted(context, text, room), 0, 0);
  context.restore();
}

/** A bar of colours with its ends named. */
export function colourBar(context, left, top, width, colour, labels, theme) {
  for (let i = 0; i < width; i += 1) {
    context.fillStyle = colour(i / Math.max(1, width - 1));
    context.fillRect(left + i, top, 1.5, 9);
  }
  fontSize(context, 11);
  context.fillStyle = theme.soft;
  context.textAlign = "center";
  for (const [at, text] of labels) context.fillText(text, left + at * width, top + 17);
}

/** A path of a figure, closed: "circle", "diamond" or "triangle". */
export function marker(context, shape, x, y, radius) {
  context.beginPath();
  if (shape === "circle") context.arc(x, y, radius, 0, 2 * Math.PI);
  else if (shape === "triangle") {
    context.moveTo(x, y - radius);
    context.lineTo(x + radius, y + radius);
    context.lineTo(x - radius, y + radius);
    context.closePath();
  } else {
    context.moveTo(x, y - radius);
    context.lineTo(x + radius, y);
    context.lineTo(x, y + radius);
    context.lineTo(x - radius, y);
    context.closePath();
  }
}
