// The belief over object and position as a heat map, with both marginals.

import { beliefScale, inkOn, viridis, viridisColour } from "./colours.js";
import { brief, colourBar, fitted, fontSize, marker, stroke, surface } from "./canvas.js";

const ROW = 26, LEAST_HEIGHT = 180, MOST_HEIGHT = 420, LEAST_ROW = 3, MOST_ROW = 60, MARGINAL = 54, TOP = 34;

/** Draws the heat map of a tap; where it lies is a property of the canvas. */
export function drawBelief(canvas, header, tap, theme) {
  const L = header.where_value.length, M = header.what_name.length;
  const rows = Math.max(LEAST_ROW * M, Math.min(MOST_ROW * M, Math.max(LEAST_HEIGHT, Math.min(ROW * M, MOST_HEIGHT))));
  const { context, width } = surface(canvas, TOP + rows + MARGINAL + 62, theme);
  const side = Math.min(nameWidth(context, header.what_name), width * 0.3) + 8;
  const what = Math.max(74, Math.min(170, width * 0.24));
  const box = { left: side, top: TOP, width: Math.max(20, width - side - what - 12), height: rows };
  canvas.heatMap = box;
  drawCells(context, box, tap.belief, L, M);
  drawPeak(context, box, tap, L, M, theme);
  drawNames(context, box, header.what_name, tap, theme);
  drawWhat(context, { ...box, left: box.left + box.width + 12, width: what - 44 }, header, tap, theme);
  drawWhere(context, box, header, tap, theme);
  const labels = [0, 10, 50, 100].map((percent) => [beliefScale(percent / 100), String(percent)]);
  if (box.width > 130) {
    const bar = Math.min(140, box.width - 68);
    colourBar(context, box.left + 62, 3, bar, viridisColour, labels, theme);
    context.textAlign = "left";
    context.fillStyle = theme.ink;
    context.fillText("belief (%)", box.left, 8);
  }
}

function nameWidth(context, names) {
  let widest = 30;
  fontSize(context, 12, 700);
  for (const name of names.slice(0, 200)) widest = Math.max(widest, context.measureText(name.slice(0, 60)).width);
  return widest;
}

function drawCells(context, box, belief, L, M) {
  const image = new ImageData(L, M);
  for (let l = 0; l < L; l += 1) {
    for (let m = 0; m < M; m += 1) image.data.set([...viridis(beliefScale(belief[l][m])), 255], 4 * (m * L + l));
  }
  const small = document.createElement("canvas");
  [small.width, small.height] = [L, M];
  small.getContext("2d").putImageData(image, 0, 0);
  context.imageSmoothingEnabled = false;
  context.drawImage(small, box.left, box.top, box.width, box.height);
  const cell = [box.width / L, box.height / M];
  if (cell[0] < 20 || cell[1] < 13) return;
  fontSize(context, 11);
  context.textAlign = "center";
  for (let l = 0; l < L; l += 1) {
    for (let m = 0; m < M; m += 1) {
      context.fillStyle = inkOn(viridis(beliefScale(belief[l][m])));
      const text = belief[l][m] < 0.005 ? "·" : (100 * belief[l][m]).toFixed(0);
      context.fillText(text, box.left + (l + 0.5) * cell[0], box.top + (m + 0.5) * cell[1] + 0.5);
    }
  }
}

function drawPeak(context, box, tap, L, M, theme) {
  const l = tap.where_index, m = tap.what_marginal.indexOf(Math.max(...tap.what_marginal));
  const [w, h] = [box.width / L, box.height / M];
  context.strokeStyle = theme.ink;
  context.lineWidth = 1;
  context.strokeRect(box.left + l * w, box.top + m * h, w, h);
}

function drawNames(context, box, names, tap, theme) {
  const height = box.height / names.length, every = Math.ceil(12 / height);
  const best = tap.what_marginal.indexOf(Math.max(...tap.what_marginal));
  context.textAlign = "right";
  names.forEach((name, m) => {
    const near = Math.abs(m - best) < every;
    if (m !== best && (m % every || near)) return;
    fontSize(context, 12, m === best ? 700 : 400);
    context.fillStyle = theme.ink;
    context.fillText(fitted(context, name, box.left - 6), box.left - 5, box.top + (m + 0.5) * height);
  });
}

function drawWhat(context, box, header, tap, theme) {
  const height = box.height / header.what_name.length;
  context.textAlign = "left";
  tap.what_marginal.forEach((value, m) => {
    const y = box.top + m * height;
    context.fillStyle = theme.bar;
    context.fillRect(box.left, y + height * 0.12, Math.max(0.5, value * box.width), Math.max(1, height * 0.76));
    if (height < 11) return;
    fontSize(context, 11);
    context.fillStyle = theme.ink;
    context.fillText(value.toFixed(3), box.left + box.width + 6, y + height / 2);
  });
  stroke(context, box.left, box.top, box.left, box.top + box.height, theme.soft);
  context.fillStyle = theme.ink;
  fontSize(context, 11);
  context.fillText("belief in object", box.left, box.top - 24);
  if (header.theta === null) return;
  const x = box.left + header.theta * box.width;
  stroke(context, x, box.top - 4, x, box.top + box.height + 2, theme.mark, [4, 3], 1.5);
  context.textAlign = "right";
  context.fillStyle = theme.mark;
  context.fillText(`threshold ${brief(header.theta)}`, box.left + box.width + 44, box.top - 10);
}

function drawWhere(context, box, header, tap, theme) {
  const L = header.where_value.length, width = box.width / L;
  const base = box.top + box.height + MARGINAL, room = MARGINAL - 8;
  tap.where_marginal.forEach((value, l) => {
    context.fillStyle = theme.bar;
    const height = Math.max(0.5, value * room);
    context.fillRect(box.left + (l + 0.1) * width, base - height, Math.max(0.8, width * 0.8), height);
  });
  stroke(context, box.left, base, box.left + box.width, base, theme.soft);
  fontSize(context, 11);
  context.fillStyle = theme.soft;
  context.textAlign = "right";
  context.fillText("1", box.left - 5, base - room);
  context.fillText("0", box.left - 5, base);
  context.textAlign = "center";
  const labels = header.where_value.map((value) => brief(value));
  const widest = Math.max(...labels.slice(0, 300).map((text) => context.measureText(text).width)) + 7;
  const every = Math.max(1, Math.ceil(widest / width));
  for (let l = 0; l < L; l += every) context.fillText(labels[l], box.left + (l + 0.5) * width, base + 10);
  context.fillStyle = theme.ink;
  const unit = header.where_unit.split(",")[0];
  context.fillText(fitted(context, unit ? `position (${unit})` : "position", box.width), box.left + box.width / 2, base + 27);
  if (header.fixation === null) return;
  const x = box.left + (header.fixation + 0.5) * width;
  context.fillStyle = theme.mark;
  marker(context, "triangle", x, base + 43, 4);
  context.fill();
  const text = "fixation point", half = context.measureText(text).width / 2;
  context.fillText(text, Math.max(half, Math.min(x, box.left + box.width + 30 - half)), base + 55);
}
