// The course of an episode: the finger over the object with its path, and evidence and p-value of each tap.

import { axes, brief, fitted, fontSize, least, marker, most, scale, stroke, surface, upright } from "./canvas.js";

/** Draws where the finger is believed to be, and was; returns a note. */
export function drawCourse(canvas, header, taps, end, theme) {
  if (header.where_place) return drawPlane(canvas, header, taps, end, theme);
  const { context, width, height } = surface(canvas, 320, theme);
  const values = header.where_value, edges = header.where_edges ?? edgesOf(values);
  const unit = header.where_unit.split(",")[0];
  const last = taps[taps.length - 1], shown = taps.length;
  const box = [44, 112, width - 14, height - 38];
  const depth = Math.max(shown, 4);
  const { x } = axes(context, box, [edges[0], edges[edges.length - 1]], [0, 1], { ...theme, line: "transparent", soft: theme.soft }, {
    xLabel: unit ? `position (${unit})` : "position",
    yLabel: "",
  });
  context.clearRect(0, box[1] - 20, box[0] - 1, box[3] - box[1] + 26);
  const y = scale(0.5, depth + 0.5, box[1], box[3]);
  fontSize(context, 11);
  context.textAlign = "right";
  context.fillStyle = theme.soft;
  for (let t = 1, every = Math.ceil(depth / 12); t <= shown; t += every) context.fillText(String(t), box[0] - 6, y(t));
  context.fillStyle = theme.ink;
  upright(context, "tap", 9, (box[1] + box[3]) / 2, box[3] - box[1]);
  drawObject(context, box, fingerName(last, end), theme);
  if (header.fixation !== null) {
    const at = x(values[header.fixation]);
    stroke(context, at, 94, at, box[3], theme.mark, [5, 4]);
    context.fillStyle = theme.mark;
    context.textAlign = at > width / 2 ? "right" : "left";
    fontSize(context, 11);
    context.fillText("fixation point", at + (at > width / 2 ? -5 : 5), 101);
  }
  const path = taps.map((tap) => [x(tap.where), y(tap.tap)]), most = Math.min(5, Math.abs(y(2) - y(1)) * 0.4);
  drawPath(context, path, theme.ink, [], "circle", taps.map((tap) => most * (0.4 + 0.6 * tap.where_belief)));
  const truth = end ? truePath(header, taps, end) : null;
  if (truth) drawPath(context, truth.map((value, t) => [x(value), y(t + 1)]), theme.true, [2, 3], "diamond", truth.map(() => most + 3));
  drawFinger(context, x(last.where), 8, 66, theme);
  const explained = truth ? " Diamonds: true position, known now." : "";
  return `Circles: most probable position, larger where more certain.${explained}`;
}

function edgesOf(values) {
  const half = values.length > 1 ? (values[1] - values[0]) / 2 : 0.5;
  return [values[0] - half, values[values.length - 1] + half];
}

function fingerName(tap, end) {
  return end && end.true_what ? `${end.true_what} (true object)` : `${tap.what} (most probable)`;
}

function drawObject(context, box, name, theme) {
  context.fillStyle = theme.line;
  context.beginPath();
  context.roundRect(box[0], 70, box[2] - box[0], 22, 8);
  context.fill();
  fontSize(context, 12);
  context.textAlign = "center";
  context.fillStyle = theme.ink;
  context.fillText(fitted(context, name, box[2] - box[0] - 16), (box[0] + box[2]) / 2, 81.5);
}

function drawFinger(context, x, top, tip, theme) {
  context.fillStyle = theme.bar;
  context.globalAlpha = 0.85;
  context.beginPath();
  context.roundRect(x - 10, top, 20, tip - top + 3, [3, 3, 10, 10]);
  context.fill();
  context.globalAlpha = 1;
}

function drawPath(context, points, colour, dash, shape, radii) {
  context.save();
  context.strokeStyle = colour;
  context.fillStyle = colour;
  context.lineWidth = 1.3;
  context.setLineDash(dash);
  context.beginPath();
  points.forEach(([x, y], t) => context[t ? "lineTo" : "moveTo"](x, y));
  context.stroke();
  context.setLineDash([]);
  points.forEach(([x, y], t) => {
    marker(context, shape, x, y, radii[t]);
    if (shape === "circle") context.fill();
    else context.stroke();
  });
  context.restore();
}

/** True positions of all taps, from the last one and the moves that were made. */
function truePath(header, taps, end) {
  if (end.true_where === null || end.true_where === undefined) return null;
  const values = header.where_value;
  let at = values.reduce((best, value, l) =>
    Math.abs(value - end.true_where) < Math.abs(values[best] - end.true_where) ? l : best, 0);
  const offset = end.true_where - values[at], path = [];
  for (let t = taps.length - 1; t >= 0; t -= 1) {
    if (values[at] === undefined) return null;
    path.unshift(values[at] + offset);
    at -= taps[t].arrived;
  }
  return path;
}

/** Positions that are places in a plane. */
function drawPlane(canvas, header, taps, end, theme) {
  const { context, width, height } = surface(canvas, 320, theme);
  const places = header.where_place, pad = (values) => {
    const low = Math.min(...values), high = Math.max(...values), more = (high - low || 1) * 0.08;
    return [low - more, high + more];
  };
  const box = [52, 10, width - 12, height - 38];
  const { x, y } = axes(context, box, pad(places.map((at) => at[0])), pad(places.map((at) => at[1])), theme, {
    xLabel: "x",
    yLabel: "y",
  });
  context.fillStyle = theme.soft;
  for (const at of places) {
    marker(context, "circle", x(at[0]), y(at[1]), 2);
    context.fill();
  }
  const path = taps.map((tap) => places[tap.where_index]);
  drawPath(context, path.map((at) => [x(at[0]), y(at[1])]), theme.ink, [], "circle", taps.map((tap) => 2 + 4 * tap.where_belief));
  const here = path[path.length - 1];
  context.strokeStyle = theme.bar;
  context.lineWidth = 3;
  marker(context, "circle", x(here[0]), y(here[1]), 9);
  context.stroke();
  if (header.fixation !== null) {
    const at = places[header.fixation];
    context.fillStyle = theme.mark;
    marker(context, "triangle", x(at[0]), y(at[1]), 5);
    context.fill();
  }
  return "Circles: most probable place of each tap, larger where more certain; ring: now; triangle: fixation point.";
}

/** Draws log evidence and p-value of each tap; returns a note. */
export function drawEvidence(canvas, header, taps, theme) {
  const { context, width, height } = surface(canvas, 220, theme);
  const known = taps.filter((tap) => tap.log_evidence !== null), judged = taps.filter((tap) => tap.p !== null);
  const range = [0.5, Math.max(taps.length, 4) + 0.5];
  const split = judged.length ? 100 : height - 36;
  const values = known.map((tap) => tap.log_evidence);
  const low = least(values), high = most(values), pad = (high - low || 1) * 0.15;
  const top = axes(context, [64, 8, width - 10, split], range, [low - pad, high + pad], theme, {
    yLabel: "evidence (nats)", xLabel: judged.length ? "" : "tap", xNumbers: !judged.length, whole: true,
  });
  drawPath(context, known.map((tap) => [top.x(tap.tap), top.y(tap.log_evidence)]), theme.bar, [], "circle", known.map(() => 3));
  if (!judged.length) return "Natural logarithm of the evidence of each tap. This model gives no p-values.";
  const floor = Math.floor(Math.log10(Math.min(Math.max(least(judged.map((tap) => tap.p)), 1e-6), header.flagged / 3))), box = [64, split + 14, width - 10, height - 36];
  const logs = (p) => Math.log10(Math.max(p, 1e-6)), y = scale(floor, 0, box[3], box[1]);
  const x = scale(range[0], range[1], box[0], box[2]);
  axes(context, box, range, [1, 1], { ...theme, line: "transparent" }, { xLabel: "tap", whole: true });
  context.clearRect(12, box[1] - 8, box[0] - 13, box[3] - box[1] + 14);
  fontSize(context, 11);
  for (let power = floor; power <= 0; power += Math.ceil(-floor / 3)) {
    stroke(context, box[0], y(power), box[2], y(power), theme.line, [], 0.5);
    context.textAlign = "right";
    context.fillStyle = theme.soft;
    context.fillText(brief(10 ** power), box[0] - 4, y(power));
  }
  context.fillStyle = theme.ink;
  upright(context, "p-value", 8, (box[1] + box[3]) / 2, box[3] - box[1] + 16);
  stroke(context, box[0], y(logs(header.flagged)), box[2], y(logs(header.flagged)), theme.mark, [4, 3], 1.5);
  for (const tap of judged) {
    context.fillStyle = tap.unusual ? theme.mark : theme.bar;
    marker(context, tap.unusual ? "diamond" : "circle", x(tap.tap), y(logs(tap.p)), tap.unusual ? 5 : 3);
    context.fill();
  }
  return `Below ${brief(header.flagged)}, the dashed line, a tap is unusual (diamond).`;
}
