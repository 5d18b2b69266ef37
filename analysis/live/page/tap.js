// The last tap: traces of its taxels, and a picture of the fingertip coloured by their peaks.

import { inkOn, lineColour, lineRgb } from "./colours.js";
import { axes, brief, colourBar, fontSize, least, most, stroke, surface } from "./canvas.js";

const MOST_TRACES = 300, NUMBERED = 64;

/** Reading of each taxel that is farthest from 0. */
export function peaksOf(readings) {
  const peaks = new Float64Array(readings[0].length);
  for (const row of readings) {
    for (let k = 0; k < peaks.length; k += 1) if (Math.abs(row[k]) > Math.abs(peaks[k])) peaks[k] = row[k];
  }
  return peaks;
}

/** Lowest and highest reading. */
export function rangeOf(readings) {
  let low = Infinity, high = -Infinity;
  for (const row of readings) {
    for (let k = 0; k < row.length; k += 1) {
      if (row[k] < low) low = row[k];
      if (row[k] > high) high = row[k];
    }
  }
  return [low, high];
}

function level(value, [low, high]) {
  return high > low ? (value - low) / (high - low) : 0.5;
}

/** Draws the readings of all taxels against time; returns a note. */
export function drawTraces(canvas, header, tap, range, theme) {
  const { context, width, height } = surface(canvas, 220, theme);
  const { samples, rate_hz: rate, pre_samples: before, taxels } = header;
  const time = (j) => (rate ? (j - before) / rate : j + 1);
  const pad = range[1] > range[0] ? 0 : 1;
  const span = samples > 1 ? [time(0), time(samples - 1)] : [time(0) - 1, time(0) + 1];
  const from = before ? "time from contact" : "time";
  const { x, y } = axes(context, [58, 8, width - 10, height - 36], span, [range[0] - pad, range[1] + pad], theme, {
    xLabel: rate ? `${from} (s)` : "sample",
    yLabel: `reading (${header.reading_unit || "unit of the sensor"})`,
    whole: !rate,
  });
  const peaks = peaksOf(tap.readings);
  const order = Array.from(peaks.keys()).sort((a, b) => Math.abs(peaks[a]) - Math.abs(peaks[b])).slice(-MOST_TRACES);
  context.lineWidth = order.length > 40 ? 0.7 : 1.5;
  for (const k of order) {
    context.strokeStyle = lineColour(level(peaks[k], range), theme);
    context.fillStyle = context.strokeStyle;
    context.beginPath();
    tap.readings.forEach((row, j) => context[j ? "lineTo" : "moveTo"](x(time(j)), y(row[k])));
    context.stroke();
    if (samples === 1) context.fillRect(x(time(0)) - 4, y(tap.readings[0][k]) - 4, 8, 8);
  }
  if (before) stroke(context, x(0), 8, x(0), height - 36, theme.soft, [3, 3]);
  const shown = taxels > MOST_TRACES ? `The ${MOST_TRACES} of ${taxels} taxels with the largest peaks. ` : "";
  return `${shown}Colours are those of the fingertip.`;
}

/** Places of the taxels, and whether they are known; a hexagonal grid stands for those that are not. */
export function placesOf(header) {
  if (header.taxel_mm) return [header.taxel_mm, true];
  const columns = Math.max(1, Math.round(Math.sqrt(header.taxels * 1.3)));
  const at = (k) => [Math.floor(k / columns), k % columns];
  return [Array.from({ length: header.taxels }, (_, k) => [at(k)[1] + (at(k)[0] % 2) / 2, -at(k)[0] * 0.87]), false];
}

function spacing(places) {
  let least = Infinity;
  const few = places.slice(0, 400);
  few.forEach(([x, y], i) => {
    for (let j = 0; j < i; j += 1) {
      const apart = Math.hypot(x - few[j][0], y - few[j][1]);
      if (apart > 1e-9 && apart < least) least = apart;
    }
  });
  return Number.isFinite(least) ? least : 1;
}

/** Draws the taxels at their places, coloured by their peaks; returns a note. */
export function drawTip(canvas, header, tap, range, theme) {
  const { context, width } = surface(canvas, 220, theme);
  const [places, known] = placesOf(header), gap = spacing(places);
  const xs = places.map(([x]) => x), ys = places.map(([, y]) => y);
  const low = [least(xs) - gap, least(ys) - gap], high = [most(xs) + gap, most(ys) + gap];
  const unit = Math.min((width - 12) / (high[0] - low[0]), 172 / (high[1] - low[1]));
  const middle = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
  const place = ([x, y]) => [width / 2 + (x - middle[0]) * unit, 88 - (y - middle[1]) * unit];
  const [w, h] = [(high[0] - low[0]) * unit, (high[1] - low[1]) * unit];
  context.strokeStyle = theme.line;
  context.lineWidth = 1.5;
  context.beginPath();
  const round = Math.min(w, h) / 2;
  context.roundRect(width / 2 - w / 2, 88 - h / 2, w, h, known ? round * 0.8 : 8);
  context.stroke();
  const radius = Math.max(1, Math.min(15, gap * unit * 0.46)), peaks = peaksOf(tap.readings);
  places.forEach((at, k) => drawTaxel(context, ...place(at), radius, level(peaks[k], range), k, places.length, theme));
  if (known) scaleBar(context, width, unit, theme);
  const bar = Math.min(150, width - 60), left = known ? 30 : (width - bar) / 2;
  const labels = range[1] > range[0] ? [[0, brief(range[0], 3)], [1, brief(range[1], 3)]] : [[0.5, brief(range[0], 3)]];
  colourBar(context, left, 190, Math.min(bar, known ? width / 2 - 20 : bar), (at) => lineColour(at, theme), labels, theme);
  return known
    ? "Peak reading of each taxel, at its place."
    : "Peak reading of each taxel. Places are not known: row by row on a hexagonal grid.";
}

function drawTaxel(context, x, y, radius, value, k, count, theme) {
  context.fillStyle = lineColour(value, theme);
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fill();
  if (radius > 4) {
    context.lineWidth = 0.7;
    context.strokeStyle = theme.soft;
    context.stroke();
  }
  if (count > NUMBERED || radius < 7) return;
  fontSize(context, 10);
  context.textAlign = "center";
  context.fillStyle = inkOn(lineRgb(value, theme));
  context.fillText(String(k), x, y + 0.5);
}

function scaleBar(context, width, unit, theme) {
  const length = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50].findLast((mm) => mm * unit < width / 3) ?? 0.1;
  const right = width - 14;
  stroke(context, right - length * unit, 194, right, 194, theme.ink, [], 2);
  fontSize(context, 11);
  context.fillStyle = theme.ink;
  context.textAlign = "center";
  context.fillText(`${length} mm`, right - (length * unit) / 2, 207);
}
