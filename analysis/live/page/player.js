// The player: what has arrived, which tap is shown, and how one moves through them.

import { themeOf } from "./colours.js";
import { drawBelief } from "./belief.js";
import { drawTip, drawTraces, rangeOf } from "./tap.js";
import { drawCourse, drawEvidence } from "./course.js";

const PACES = [2, 1, 0.5, 0.25, 0.1, 0.05];
const KEYS = [
  [["Space"], "play or pause"], [["←", "→"], "one tap back or on"], [["Home", "End"], "first or newest tap"],
  [["PgUp", "PgDn"], "episode before or after"], [["+", "−"], "faster or slower"],
];

/** An element with a class, properties and children; text is text, never markup. */
function element(tag, name = "", properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  if (name) made.className = name;
  made.append(...children);
  return made;
}

/**
 * Makes an element show episodes.
 *
 * `live` follows what arrives, `autoplay` plays what is there from its first tap, `wide` takes keys of the whole page,
 * `stop` is called by the button that stops the rig, and `memory` is how many numbers are kept before the oldest
 * episodes are left out.
 */
export function createPlayer(root, { live = false, autoplay = false, wide = false, stop = null, memory = 5e7 } = {}) {
  const taps = [], episodes = new Map(), shownAt = [];
  let header = null, at = -1, pace = 0.5, following = live, playing = live, running = live;
  let timer = null, drawing = false, numbers = 0, theme = null, wasAt = -1;
  const parts = build(root, { stop, act });

  function act(kind, value) {
    if (kind === "play") play(!playing);
    else if (kind === "step") go(at + value);
    else if (kind === "first") go(episodeOf(at)?.first ?? 0);
    else if (kind === "newest") newest();
    else if (kind === "seek") go((episodeOf(at)?.first ?? 0) + value);
    else if (kind === "episode") go(episodes.get(value)?.first ?? at);
    else if (kind === "turn") turn(value);
    else if (kind === "pace") setPace(value);
    else if (kind === "faster") setPace(PACES[Math.max(0, Math.min(PACES.length - 1, PACES.indexOf(pace) + value))]);
    else if (kind === "numbers") schedule();
  }

  function episodeOf(index) {
    return index < 0 || index >= taps.length ? undefined : episodes.get(taps[index].episode);
  }

  function go(index) {
    following = false;
    play(false);
    show(Math.max(0, Math.min(taps.length - 1, index)));
  }

  function newest() {
    show(taps.length - 1);
    following = running;
    play(running);
  }

  function turn(by) {
    const numbersOf = [...episodes.keys()], here = numbersOf.indexOf(taps[at]?.episode);
    const next = episodes.get(numbersOf[Math.max(0, Math.min(numbersOf.length - 1, here + by))]);
    if (next) go(next.first);
  }

  function setPace(value) {
    pace = value;
    if (playing && !following) wait();
    schedule();
  }

  function play(on) {
    playing = on;
    following &&= on;
    clearTimeout(timer);
    if (on && at >= taps.length - 1) {
      if (running) following = true;
      else if (taps.length) at = 0;
    }
    if (on && !following) wait();
    schedule();
  }

  function wait() {
    clearTimeout(timer);
    const pause = episodeOf(at)?.end && at === episodeOf(at).first + episodeOf(at).count - 1 ? 3 : 1;
    timer = setTimeout(onward, 1000 * pace * pause);
  }

  function onward() {
    if (at < taps.length - 1) {
      show(at + 1);
      if (at < taps.length - 1 || running) wait();
      else play(false);
    } else if (running) {
      following = true;
      schedule();
    } else play(false);
    if (playing && running && at === taps.length - 1) following = true;
  }

  function show(index) {
    at = index;
    schedule();
  }

  function schedule() {
    if (drawing) return;
    drawing = true;
    requestAnimationFrame(draw);
  }

  function draw() {
    drawing = false;
    if (!root.isConnected) return;
    theme ??= themeOf(root);
    drawControls();
    if (!header || at < 0) return;
    const tap = taps[at], own = episodes.get(tap.episode), so = taps.slice(own.first, at + 1);
    const end = at === own.first + own.count - 1 ? own.end : null;
    if (wasAt !== at || parts.end.textContent !== (end?.sentence ?? "")) say(tap, end);
    wasAt = at;
    drawBelief(parts.belief.canvas, header, tap, theme);
    label(parts.course, drawCourse(parts.course.canvas, header, so, end, theme), tap);
    label(parts.tip, drawTip(parts.tip.canvas, header, tap, own.range, theme), tap);
    label(parts.traces, drawTraces(parts.traces.canvas, header, tap, own.range, theme), tap);
    label(parts.evidence, drawEvidence(parts.evidence.canvas, header, so, theme), tap);
    parts.belief.canvas.setAttribute("aria-label", `Belief in objects and positions. ${tap.sentence}`);
    if (parts.numbers.open) tabulate(parts.table, header, tap);
    Object.assign(root.dataset, { tap: tap.tap, episode: tap.episode });
    if (end) root.dataset.decided = end.right === null ? "" : end.right ? "right" : "wrong";
    else delete root.dataset.decided;
    shownAt[at] ??= Date.now();
  }

  function label(panel, note, tap) {
    panel.note.textContent = note;
    panel.canvas.setAttribute("aria-label", `${panel.title}. Tap ${tap.tap}. ${note}`);
  }

  function say(tap, end) {
    parts.sentence.textContent = tap.sentence;
    const verdict = end?.right === true ? " Right." : end?.right === false ? " Wrong." : "";
    parts.end.textContent = end ? `${end.sentence}${verdict}` : "";
  }

  function drawControls() {
    const own = episodeOf(at);
    parts.play.textContent = playing ? "❚❚ Pause" : "▶ Play";
    parts.play.disabled = !taps.length;
    parts.newest.hidden = !running;
    parts.newest.setAttribute("aria-pressed", String(following));
    parts.pace.value = String(pace);
    parts.before.disabled = at <= 0;
    parts.after.disabled = at >= taps.length - 1;
    parts.seek.disabled = !own || own.count < 2;
    parts.seek.max = String(own ? own.count - 1 : 0);
    parts.seek.value = String(own ? at - own.first : 0);
    parts.seek.setAttribute("aria-valuetext", own ? `tap ${taps[at].tap}` : "no tap");
    const behind = taps.length - 1 - at;
    parts.place.textContent = own ? `tap ${taps[at].tap} of ${own.count}${running && behind ? `, ${behind} behind` : ""}` : "no tap yet";
    parts.episode.hidden = episodes.size < 2;
    if (parts.episode.options.length !== episodes.size || parts.episode.dataset.first !== String([...episodes.keys()][0])) {
      parts.episode.replaceChildren(...[...episodes.keys()].map((n) => element("option", "", { value: String(n), textContent: `episode ${n}` })));
      parts.episode.dataset.first = String([...episodes.keys()][0]);
    }
    if (own) parts.episode.value = String(taps[at].episode);
    root.dataset.taps = taps.length;
  }

  function forget() {
    while (numbers > memory && episodes.size > 1) {
      const [[number, oldest]] = episodes;
      episodes.delete(number);
      const gone = taps.splice(0, oldest.count);
      shownAt.splice(0, oldest.count);
      numbers -= gone.length * size();
      for (const other of episodes.values()) other.first -= oldest.count;
      at = Math.max(0, at - oldest.count);
    }
  }

  function size() {
    return header.where_value.length * header.what_name.length + header.samples * header.taxels;
  }

  const player = {
    taps, episodes, shownAt, draw,
    get header() { return header; },
    get at() { return at; },
    get playing() { return playing; },
    get following() { return following; },
    get pace() { return pace; },
    begin(value) {
      header = value;
      parts.heading.textContent = header.heading;
      schedule();
    },
    tap(tap) {
      if (!episodes.has(tap.episode)) episodes.set(tap.episode, { first: taps.length, count: 0, end: null, range: [Infinity, -Infinity] });
      const own = episodes.get(tap.episode), [low, high] = rangeOf(tap.readings);
      own.count += 1;
      own.range = [Math.min(own.range[0], low), Math.max(own.range[1], high)];
      taps.push(tap);
      numbers += size();
      forget();
      if (following || at < 0) at = following ? taps.length - 1 : 0;
      schedule();
    },
    end(end) {
      const own = episodes.get(end.episode);
      if (own) own.end = end;
      schedule();
    },
    finish(text) {
      running = false;
      if (following) playing = false;
      following = false;
      parts.stop.hidden = true;
      player.status("ended", text);
    },
    status(kind, text) {
      root.dataset.status = kind;
      parts.status.textContent = text;
      schedule();
    },
    stoppable(on) {
      parts.stop.hidden = !on;
    },
    load({ header: value, taps: all, ends }) {
      player.begin(value);
      all.forEach(player.tap);
      ends.forEach(player.end);
      show(autoplay ? 0 : taps.length - 1);
      if (autoplay) play(true);
    },
    hold() {
      following = playing = false;
    },
    play: () => play(true),
    key: (event) => key(event, act),
  };
  const keys = wide ? document : root;
  keys.addEventListener("keydown", player.key);
  const size_ = new ResizeObserver(() => schedule());
  size_.observe(root);
  const dark = matchMedia("(prefers-color-scheme: dark)"), recolour = () => { theme = null; schedule(); };
  dark.addEventListener("change", recolour);
  addEventListener("beforeprint", recolour);
  document.addEventListener("visibilitychange", schedule);
  player.remove = () => {
    clearTimeout(timer);
    keys.removeEventListener("keydown", player.key);
    size_.disconnect();
    dark.removeEventListener("change", recolour);
    removeEventListener("beforeprint", recolour);
    document.removeEventListener("visibilitychange", schedule);
    root.replaceChildren();
  };
  root.player = player;
  player.status(live ? "waiting" : "saved", live ? "waiting for the program" : "");
  return player;
}

function key(event, act) {
  if (event.ctrlKey || event.altKey || event.metaKey || event.target.closest?.("select, summary, .st-scroll")) return;
  const range = event.target.type === "range", button = event.target.closest?.("button");
  const table = {
    ArrowLeft: ["step", -1], ArrowRight: ["step", 1], Home: ["first"], End: ["newest"], PageUp: ["turn", -1],
    PageDown: ["turn", 1], " ": ["play"], "+": ["faster", 1], "=": ["faster", 1], "-": ["faster", -1],
  };
  const found = table[event.key];
  if (!found || (button && event.key === " ") || (range && /^(Arrow|Home|End|Page)/.test(event.key))) return;
  event.preventDefault();
  act(...found);
}

/** Everything in the element, by name. */
function build(root, { stop, act }) {
  const button = (text, title, kind, value) => {
    const made = element("button", "", { type: "button", textContent: text, title, onclick: () => act(kind, value) });
    made.setAttribute("aria-label", title);
    return made;
  };
  const parts = {
    heading: element("p", "st-heading"),
    status: element("p", "st-status"),
    play: button("▶ Play", "Play or pause", "play"),
    before: button("◀", "One tap back", "step", -1),
    after: button("▶|", "One tap on", "step", 1),
    newest: button("Live", "Follow the newest tap", "newest"),
    seek: element("input", "", { type: "range", min: "0", value: "0", oninput: (event) => act("seek", Number(event.target.value)) }),
    place: element("span", "st-place"),
    pace: element("select", "", { title: "Pace", onchange: (event) => act("pace", Number(event.target.value)) },
      ...PACES.map((s) => element("option", "", { value: String(s), textContent: `${s} s per tap` }))),
    episode: element("select", "", { title: "Episode", onchange: (event) => act("episode", Number(event.target.value)) }),
    stop: element("button", "st-stop", { type: "button", textContent: "Stop the rig", hidden: !stop, onclick: () => stop?.() }),
    sentence: element("p", "st-sentence"),
    end: element("p", "st-end"),
    table: element("tbody"),
  };
  parts.play.removeAttribute("aria-label");
  parts.seek.setAttribute("aria-label", "Tap");
  parts.pace.setAttribute("aria-label", "Pace");
  parts.episode.setAttribute("aria-label", "Episode");
  const words = element("div", "st-words", {}, parts.sentence, parts.end);
  words.setAttribute("aria-live", "polite");
  const panels = element("div", "st-panels");
  for (const [name, title] of [
    ["belief", "Belief over object and position"], ["course", "Finger and path"], ["tip", "Fingertip"],
    ["traces", "Readings of the tap"], ["evidence", "Evidence and p-value of each tap"],
  ]) {
    const canvas = element("canvas"), note = element("p", "st-note");
    canvas.setAttribute("role", "img");
    parts[name] = { canvas, note, title };
    panels.append(element("div", `st-panel st-${name}`, {}, element("p", "st-title", { textContent: title }), canvas, note));
  }
  const scroll = element("div", "st-scroll", { tabIndex: 0 }, element("table", "", {}, parts.table));
  parts.numbers = element("details", "st-numbers", { ontoggle: () => act("numbers") },
    element("summary", "", { textContent: "Numbers of this tap" }), scroll);
  const keys = element("p", "st-keys", {}, "Keys: ");
  KEYS.forEach(([names, meaning], i) => {
    for (const name of names) keys.append(element("kbd", "", { textContent: name }), " ");
    keys.append(`${meaning}${i < KEYS.length - 1 ? " · " : ""}`);
  });
  root.classList.add("st-player");
  root.tabIndex = 0;
  root.setAttribute("role", "region");
  root.setAttribute("aria-label", "Episodes of perception");
  root.replaceChildren(
    element("div", "st-head", {}, parts.heading, parts.status),
    element("div", "st-controls", {}, parts.play, parts.before, parts.after, parts.seek, parts.place, parts.pace, parts.episode, parts.newest, parts.stop),
    words, panels, parts.numbers, keys,
  );
  return parts;
}

/** All numbers of a tap as text, as the program prints them. */
function tabulate(table, header, tap) {
  const unit = header.where_unit ? ` (${header.where_unit})` : "";
  const plain = ["tap", "what", "what_belief", "where", "where_index", "where_belief", "log_evidence", "p", "unusual", "arrived", "move"];
  const rows = plain.map((name) => [name === "where" ? `where${unit}` : name, tap[name], name]);
  tap.what_marginal.forEach((value, m) => rows.push([`belief in ${header.what_name[m]}`, value, `what_marginal.${m}`]));
  tap.where_marginal.forEach((value, l) => rows.push([`belief at ${header.where_label[l]}`, value, `where_marginal.${l}`]));
  table.replaceChildren(...rows.map(([name, value, id]) => {
    const row = element("tr", "", {}, element("th", "", { scope: "row", textContent: name }), element("td", "", { textContent: String(value ?? "–") }));
    row.dataset.name = id;
    return row;
  }));
}
