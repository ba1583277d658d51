// The keyboard: what each key does just now, and the list of it that `?` shows.

import { el, fill } from "./dom.js";

const bound = new Set();
const NAMES = { ArrowUp: "↑", ArrowDown: "↓", ArrowLeft: "←", ArrowRight: "→", " ": "Space", Escape: "Esc" };

/** Bind keys (as `KeyboardEvent.key` has them) to an action until the signal aborts; `says` is for the list. */
export function onKeys(keys, says, action, signal = null) {
  const entry = { keys, says, action };
  bound.add(entry);
  signal?.addEventListener("abort", () => bound.delete(entry));
}

/** Listen; the keys of the view that is shown come before those of the page. */
export function beginKeys() {
  onKeys(["?"], "show these keys", showKeys);
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || isTaken(event)) return;
    const entry = [...bound].reverse().find(({ keys }) => keys.includes(event.key));
    if (!entry) return;
    event.preventDefault();
    entry.action(event);
  });
}

/** Show what the keys do. */
export function showKeys() {
  const dialog = el("dialog", { class: "keys", "aria-labelledby": "keys-title" });
  const entries = [...bound].filter(({ says }) => says);
  fill(
    dialog,
    el("h2", { id: "keys-title" }, "Keys"),
    el(
      "dl",
      {},
      entries.map(({ keys, says }) => [
        el(
          "dt",
          {},
          keys.map((key) => el("kbd", {}, NAMES[key] ?? key)),
        ),
        el("dd", {}, says),
      ]),
    ),
    el("button", { type: "button", onclick: () => dialog.close() }, "Close"),
  );
  dialog.addEventListener("close", () => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();
}

function isTaken(event) {
  if (document.querySelector("dialog[open]")) return true;
  const typing = event.target.closest?.("input:not([type=checkbox]), textarea, select");
  if (typing && event.key === "Escape") typing.blur();
  return Boolean(typing) || (event.key === "Enter" && event.target.closest?.("a, button"));
}
