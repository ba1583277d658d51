// A question of the run to its operator: what is to be done now, and the answer.

import { ApiError, campaignPath, change } from "./api.js";
import { el, fill, say } from "./dom.js";
import { nameField, session } from "./session.js";
import { holdButton } from "./stop.js";

/** The open question of a campaign; nothing while there is none. */
export class Prompt {
  constructor(campaign) {
    this.campaign = campaign;
    this.open = "";
    this.root = el("section", { class: "prompt", role: "alert", hidden: true });
  }

  show(question) {
    if (this.open === (question?.id ?? "")) return;
    this.open = question?.id ?? "";
    this.root.hidden = !question;
    if (!question) return void fill(this.root);
    const text = el("p", { class: "what" }, el("b", {}, "Now: "), question.text);
    if (!session.mayOperate)
      return void fill(this.root, text, el("p", { class: "how" }, "The run waits for the operator."));
    const who = nameField("answerer", this.campaign.operator);
    const wrong = el("p", { class: "wrong" });
    const answer = (value) => this.answer(value, who, wrong);
    fill(
      this.root,
      text,
      el("label", { for: "answerer" }, "Your name ", who),
      el(
        "div",
        { class: "buttons" },
        el("button", { type: "button", class: "main", onclick: () => answer("done") }, "It is done"),
        el("span", { class: "gap" }),
        holdButton("Refuse: hold for 2 s to end the run", () => answer("refuse")),
      ),
      wrong,
    );
  }

  async answer(value, who, wrong) {
    if (!who.reportValidity()) return;
    const body = { question: this.open, answer: value, who: who.value.trim() };
    for (const button of this.root.querySelectorAll("button")) button.disabled = true;
    try {
      await change("POST", campaignPath(this.campaign.id, "/answer"), { body });
      fill(this.root, el("p", { class: "how" }, "Answered: the run goes on in a moment."));
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      say(wrong, `Not answered: ${error.message}.`);
      for (const button of this.root.querySelectorAll("button")) button.disabled = false;
    }
  }
}
