// What must not be overlooked, above everything else: announced at once where it is bad, politely where it is not.

import { connection, isLost, tryNow } from "./connection.js";
import { el, fill, say } from "./dom.js";

const shown = new Map();

/** Show a banner until `hide`: `key` names it, `parts` are its paragraphs, the level is bad, warn or good. */
export function show(key, level, ...parts) {
  const text = parts
    .flat()
    .map((part) => part.textContent ?? part)
    .join("\n");
  if (shown.get(key)?.text === text) return;
  hide(key);
  const banner = el(
    "div",
    { class: `banner ${level}` },
    parts.map((part) => el("p", {}, part)),
  );
  document.getElementById(level === "bad" ? "alerts" : "news").append(banner);
  shown.set(key, { text, banner });
}

/** Take a banner away. */
export function hide(key) {
  shown.get(key)?.banner.remove();
  shown.delete(key);
}

/** A command to be copied. */
export function command(text) {
  const button = el("button", { type: "button", class: "copy", onclick: copy, "aria-label": `copy: ${text}` }, "copy");
  async function copy() {
    await navigator.clipboard.writeText(text);
    say(button, "copied");
  }
  const mayCopy = Boolean(navigator.clipboard);
  return el("span", { class: "command" }, el("code", {}, text), mayCopy && button);
}

/** Say so when the server cannot be reached, count down to the next try, and when it is back. */
export function watchConnection() {
  let counting = 0;
  const when = el("span", {});
  const banner = el(
    "div",
    { class: "banner bad", id: "unreachable" },
    el(
      "p",
      {},
      el("b", {}, "The server does not answer."),
      " What is shown is old. A run that is going on goes on without it. ",
      when,
    ),
    el(
      "p",
      {},
      "Is ",
      el("code", {}, "benchctl serve"),
      " still running, and the network up? ",
      el("button", { type: "button", onclick: tryNow }, "Try now"),
    ),
  );
  connection.addEventListener("lost", ({ detail: { again_s } }) => {
    const until = performance.now() + 1000 * again_s;
    const tell = () => say(when, `Trying again in ${Math.max(0, Math.ceil((until - performance.now()) / 1000))} s.`);
    clearInterval(counting);
    counting = setInterval(tell, 250);
    tell();
    hide("back");
    if (!banner.isConnected)
      fill(document.getElementById("alerts"), banner, ...document.getElementById("alerts").children);
    document.documentElement.classList.add("unreachable");
  });
  connection.addEventListener("trying", () => (clearInterval(counting), say(when, "Trying …")));
  connection.addEventListener("back", () => {
    clearInterval(counting);
    document.documentElement.classList.remove("unreachable");
    if (!banner.isConnected) return;
    banner.remove();
    show("back", "good", "The server answers again.");
    setTimeout(() => isLost() || hide("back"), 6000);
  });
}
