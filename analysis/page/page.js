// What a page does beyond being read: folded parts open for links and for printing, what is cut off at the side
// fades, and curves tell their values and can be switched off. Without it every text, table and figure is there.
"use strict";

function reveal() {
  const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (!target) return;
  for (let part = target; part; part = part.parentElement) if (part.localName === "details") part.open = true;
  target.scrollIntoView();
}

function showMore(part) {
  const more = part.scrollWidth - part.clientWidth - Math.abs(part.scrollLeft) > 1;
  part.classList.toggle("more", more);
}

function element(name, options, ...children) {
  const made = Object.assign(document.createElement(name), options);
  made.append(...children);
  return made;
}

// The same drawing in place of its picture, so that parts of it can be hidden; ids stay its own in a shadow root.
function drawingOf(image) {
  const [, data] = image.src.split("data:image/svg+xml,");
  if (!data) return null;
  const svg = new DOMParser().parseFromString(decodeURIComponent(data), "image/svg+xml").documentElement;
  svg.style.cssText = "display: block; width: 100%; height: auto";
  svg.setAttribute("aria-hidden", "true");
  const host = element("div", { className: "drawing" });
  const root = host.attachShadow({ mode: "open" });
  root.append(document.importNode(svg, true));
  image.after(host);
  return root;
}

class Curves {
  constructor(figure) {
    this.panels = JSON.parse(figure.dataset.curves);
    this.series = this.panels.flatMap((panel) => panel.series.map((one) => ({ ...one, panel, off: false })));
    this.plot = figure.querySelector(".plot");
    this.scroll = this.plot.parentElement;
    this.mark = element("span", { className: "mark", hidden: true });
    this.told = element("div", { className: "told", hidden: true });
    this.told.setAttribute("role", "status");
    this.plot.append(this.mark, this.told);
    this.scroll.setAttribute("role", "group");
    this.scroll.setAttribute("aria-label", "Values of the curves: arrow keys");
    this.plot.addEventListener("pointermove", (event) => this.near(event));
    this.plot.addEventListener("pointerdown", (event) => this.near(event));
    this.plot.addEventListener("pointerleave", () => this.hide());
    this.scroll.addEventListener("keydown", (event) => this.key(event));
    this.scroll.addEventListener("blur", () => this.hide());
    const labels = [...new Set(this.series.map((one) => one.label))];
    const root = labels.length > 1 && drawingOf(figure.querySelector("img"));
    const names = new Set(labels.map((label) => /^(\D+) [\d.]+$/.exec(label)?.[1]));
    const [name] = names.size === 1 ? names : [];
    if (root) figure.querySelector("figcaption").before(name ? this.scale(name, labels, root) : this.legend(labels, root));
  }

  // Off curves tell nothing.
  change(series, off, root, property, value) {
    for (const one of series) {
      one.off = off;
      for (const id of one.parts) root.getElementById(id)?.style.setProperty(property, value);
    }
    this.hide();
  }

  // Of curves on a scale, such as one of thresholds, all or one.
  scale(name, labels, root) {
    const range = element("input", { type: "range", max: labels.length, value: 0 });
    const output = element("output", {}, `all ${name}s`);
    range.addEventListener("input", () => {
      const chosen = labels[range.value - 1];
      output.textContent = chosen ?? `all ${name}s`;
      range.setAttribute("aria-valuetext", output.textContent);
      for (const one of this.series) {
        const off = Boolean(chosen) && one.label !== chosen;
        this.change([one], off, root, "opacity", off ? 0.1 : 1);
      }
    });
    return element("label", { className: "legend" }, "Show", range, output);
  }

  legend(labels, root) {
    const legend = element("div", { className: "legend" });
    legend.setAttribute("role", "group");
    legend.setAttribute("aria-label", "Curves shown");
    for (const label of labels) {
      const own = this.series.filter((one) => one.label === label);
      const swatch = element("i");
      swatch.style.background = own[0].colour;
      const button = element("button", { type: "button" }, swatch, label);
      button.setAttribute("aria-pressed", "true");
      button.addEventListener("click", () => {
        const off = button.getAttribute("aria-pressed") === "true";
        button.setAttribute("aria-pressed", String(!off));
        this.change(own, off, root, "display", off ? "none" : "inline");
      });
      legend.append(button);
    }
    return legend;
  }

  get shown() {
    return this.series.filter((one) => !one.off);
  }

  near(event) {
    const area = this.plot.getBoundingClientRect();
    const x = (event.clientX - area.left) / area.width;
    const y = (event.clientY - area.top) / area.height;
    const far = ([px, py]) => Math.hypot((px - x) * area.width, (py - y) * area.height);
    let best = 40; // pixels
    let found = null;
    for (const one of this.shown) {
      const [left, top, right, bottom] = one.panel.box;
      if (x < left - 0.02 || x > right + 0.02 || y < top - 0.02 || y > bottom + 0.02) continue;
      one.points.forEach((point, i) => {
        if (far(point) < best) [best, found] = [far(point), [one, i]];
      });
    }
    if (found) this.show(...found);
    else this.hide();
  }

  key(event) {
    const shown = this.shown;
    if (event.target !== this.scroll || event.ctrlKey || event.altKey || event.metaKey || !shown.length) return;
    const [one, i] = this.at && !this.at[0].off ? this.at : [shown[0], -1];
    const last = one.points.length - 1;
    const step = { ArrowRight: i + 1, ArrowLeft: i - 1, Home: 0, End: last }[event.key];
    const turn = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (event.key === "Escape") this.hide();
    else if (step !== undefined) this.show(one, Math.min(Math.max(step, 0), last));
    else if (turn) {
      const next = shown[(shown.indexOf(one) + (i < 0 ? 0 : turn) + shown.length) % shown.length];
      this.show(next, Math.min(Math.max(i, 0), next.points.length - 1));
    } else return;
    event.preventDefault();
  }

  show(one, i) {
    const [x, y, xText, yText, name] = one.points[i];
    const value = (label, text) => (text ? (label ? `${label}: ${text}` : text) : "");
    const first = [one.panel.title, one.label].filter(Boolean).join(" – ");
    const lines = [first, value(one.panel.y, yText), value(one.panel.x, xText), name];
    this.at = [one, i];
    this.told.textContent = lines.filter(Boolean).join("\n");
    this.mark.style.cssText = `left: ${100 * x}%; top: ${100 * y}%; border-color: ${one.colour}`;
    this.told.style.cssText = `${x > 0.5 ? "right" : "left"}: ${100 * (x > 0.5 ? 1 - x : x)}%; top: ${100 * y}%`;
    this.told.classList.toggle("above", y > 0.5);
    this.mark.hidden = this.told.hidden = false;
  }

  hide() {
    this.at = null;
    this.mark.hidden = this.told.hidden = true;
  }
}

for (const figure of document.querySelectorAll("figure[data-curves]")) new Curves(figure);
for (const part of document.querySelectorAll(".scroll")) {
  part.addEventListener("scroll", () => showMore(part), { passive: true });
  new ResizeObserver(() => showMore(part)).observe(part);
}
const opened = [];
addEventListener("beforeprint", () => {
  for (const part of document.querySelectorAll("details:not([open])")) opened.push(part), (part.open = true);
});
addEventListener("afterprint", () => {
  for (const part of opened.splice(0)) part.open = false;
});
addEventListener("hashchange", reveal);
document.addEventListener("click", ({ target }) => {
  if (target.closest("a")?.hash === location.hash) reveal(); // the same link again changes no hash
});
reveal();
