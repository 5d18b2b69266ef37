// The page of a running program: its events, and the one command that it takes.

import { createPlayer } from "./player.js";

const root = document.getElementById("player");
const player = createPlayer(root, { live: true, wide: true, stop });
const events = new EventSource("events");
let last = 0, told = false;
player.stoppable(false);

function on(kind, act) {
  events.addEventListener(kind, (event) => {
    const number = Number(event.lastEventId);
    if (number <= last) return;
    last = number;
    act(JSON.parse(event.data));
  });
}

on("start", ({ header, stoppable, saved }) => {
  player.begin(header);
  player.stoppable(stoppable);
  if (saved) player.hold();
  document.title = `solidtouch: ${header.heading}`;
});
on("tap", player.tap);
on("end", player.end);
on("finished", ({ text, saved }) => {
  told = true;
  events.close();
  player.finish(text);
  if (saved && !matchMedia("(prefers-reduced-motion: reduce)").matches) player.play();
});
events.onopen = () => player.status("live", "connected");
events.onerror = () => {
  if (told) return;
  const closed = events.readyState === EventSource.CLOSED;
  player.status("lost", closed ? "the program has ended; this page keeps what it has" : "no connection; trying again");
};

async function stop() {
  player.status("live", "stopping the rig");
  try {
    const answer = await fetch("stop", { method: "POST" });
    if (!answer.ok) player.status("lost", `the program did not stop: ${answer.status}`);
  } catch {
    player.status("lost", "the program cannot be reached");
  }
}
