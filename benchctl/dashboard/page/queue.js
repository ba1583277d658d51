// The queue of the station: the run on the bench, what waits behind it, why it holds, and what an operator can do.

import { ApiError, change, get, repeat, unlessAway } from "./api.js";
import { el, fill, say } from "./dom.js";
import { link } from "./router.js";
import { givenName, session } from "./session.js";

const AGAIN_MS = 2000;

/** The queue as the server has it. */
export function queueNow(signal) {
  return get("/api/queue", {}, signal);
}

/** An id for an order, which the server carries out once. */
export function newOrder() {
  return Array.from(crypto.getRandomValues(new Uint8Array(8)), (byte) => byte.toString(16).padStart(2, "0")).join("");
}

/** The queue, kept up to date; `who()` returns the operator's name, `changed(queue)` is called with each new state. */
export class QueuePanel {
  constructor(signal, { who = givenName, changed = () => {} } = {}) {
    Object.assign(this, { signal, who, changed, known: "" });
    this.body = el("div", {});
    this.wrong = el("p", { class: "wrong", role: "alert" });
    this.root = el("section", { class: "queue", "aria-label": "queue", hidden: true }, this.body, this.wrong);
    const look = async () => this.show(await queueNow(signal));
    unlessAway(look, signal);
    repeat(look, AGAIN_MS, signal);
  }

  show(queue) {
    const fresh = JSON.stringify(queue);
    if (fresh === this.known) return;
    this.known = fresh;
    const { run, held, waiting } = queue;
    const isOn = run?.fault === null;
    this.root.hidden = !isOn && !held && !waiting.length;
    fill(
      this.body,
      el("h2", {}, "Queue"),
      isOn && el("p", {}, "On the bench: ", campaignLink(run), ` (${run.title}, ${run.serial}, ${run.who})`),
      held && !isOn && this.hold(queue),
      waiting.length > 0 &&
        el(
          "ol",
          {},
          waiting.map((one) => el("li", {}, `${one.title}, ${one.serial}, by ${one.who} `, this.removal(one))),
        ),
    );
    this.changed(queue);
  }

  hold({ run, held, hold, waiting }) {
    const next = waiting.length ? "Go on with the next" : "Go on";
    const act = (resume) => () => this.act("/api/queue/go_on", { hold, resume });
    const button = (title, resume) => el("button", { type: "button", onclick: act(resume) }, title);
    return el(
      "div",
      { class: "answer bad", role: "alert" },
      el("p", {}, el("b", {}, "The queue holds: "), held, "."),
      run?.fault && el("p", {}, "Look at the bench, then at ", campaignLink(run), "."),
      session.mayStart &&
        el("div", { class: "buttons" }, run?.fault && button("Resume this run", true), button(next, false)),
    );
  }

  removal({ order, serial }) {
    const path = `/api/queue/${order}/remove`;
    return (
      session.mayStart &&
      el("button", { type: "button", "aria-label": `remove ${serial}`, onclick: () => this.act(path, {}) }, "Remove")
    );
  }

  async act(path, body) {
    const who = this.who();
    if (!who) return void say(this.wrong, "Not done: give your name at Start first, for the journal.");
    const buttons = this.root.querySelectorAll("button");
    for (const button of buttons) button.disabled = true;
    say(this.wrong, "");
    try {
      this.show(await change("POST", path, { body: { ...body, who } }));
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      say(this.wrong, `Not done: ${error.message}.`);
    } finally {
      for (const button of buttons) button.disabled = false;
    }
  }
}

function campaignLink({ campaign, name }) {
  return el("a", { href: link(["campaigns", campaign]) }, name);
}
