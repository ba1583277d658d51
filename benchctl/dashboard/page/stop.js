// Stopping a run: asked first, with what will happen; then when it was asked and when it was done.

import { ApiError, campaignPath, change } from "./api.js";
import { el, fill, say } from "./dom.js";
import { givenName } from "./session.js";

const HOLD_MS = 2000;

/** Ask whether to stop; calls `asked(date)` once the server has taken it. */
export function askToStop(campaign, asked) {
  const dialog = el("dialog", { class: "stop", "aria-labelledby": "stop-title", "aria-describedby": "stop-says" });
  const wrong = el("p", { class: "wrong", role: "alert" });
  const input = el("input", {
    id: "confirm",
    autocomplete: "off",
    spellcheck: "false",
    oninput: compare,
    onkeydown: enter,
  });
  const stop = el("button", { type: "button", class: "danger", disabled: true, onclick: send }, "Stop the run");
  const hold = holdButton("Or hold for 2 s to stop", send);

  function compare() {
    stop.disabled = input.value.trim() !== campaign.name;
  }

  function enter(event) {
    if (event.key === "Enter" && !stop.disabled) send();
  }

  async function send() {
    stop.disabled = true;
    try {
      await change("POST", campaignPath(campaign.id, "/stop"), { body: { confirm: campaign.name, who: givenName() } });
      asked(new Date());
      dialog.close();
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      say(wrong, `Not stopped: ${error.message}.`);
      compare();
    }
  }

  fill(
    dialog,
    el("h2", { id: "stop-title" }, "Stop this run?"),
    el(
      "div",
      { id: "stop-says" },
      el(
        "ol",
        {},
        el("li", {}, "The step that is being recorded is cut and marked so; every finished step stays whole."),
        el("li", {}, "The table comes to rest."),
        el("li", {}, "The chamber goes to its safe set point."),
        el("li", {}, "Both are read back, and the recording says why the run ended."),
      ),
      el("p", {}, "It can go on later, after a new soak: ", el("code", {}, "benchctl run … --resume"), "."),
      el("p", { class: "how" }, "This page is no emergency stop: what endangers people is stopped at the bench."),
    ),
    el("label", { for: "confirm" }, "To confirm, type the campaign’s name ", el("b", { class: "name" }, campaign.name)),
    input,
    wrong,
    el(
      "div",
      { class: "buttons" },
      el("button", { type: "button", onclick: () => dialog.close() }, "Let it run"),
      el("span", { class: "gap" }),
      hold,
      stop,
    ),
  );
  dialog.addEventListener("close", () => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();
  input.focus();
}

/** A button that has to be held. */
export function holdButton(title, done) {
  const button = el("button", { type: "button", class: "hold" }, title);
  let timer = 0;
  const begin = (event) => {
    if (event.repeat || (event.key && event.key !== " " && event.key !== "Enter")) return;
    if (event.key) event.preventDefault();
    clearTimeout(timer);
    button.classList.add("holding");
    timer = setTimeout(() => (end(), done()), HOLD_MS);
  };
  const end = () => (clearTimeout(timer), button.classList.remove("holding"));
  for (const name of ["pointerdown", "keydown"]) button.addEventListener(name, begin);
  for (const name of ["pointerup", "pointerleave", "pointercancel", "keyup", "blur"])
    button.addEventListener(name, end);
  return button;
}
