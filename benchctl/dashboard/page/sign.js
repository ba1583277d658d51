// The signature of an acceptance: by whom it is signed, or the way to sign it with the key that lies on the station.

import { ApiError, campaignPath, change } from "./api.js";
import { el, say } from "./dom.js";
import { nameField, session } from "./session.js";

/** By whom an acceptance is signed; where it is not, a form for those who may sign; `done` is called once it is. */
export function signing(campaign, { verdict, signed }, done) {
  if (signed) return signature(signed);
  if (!session.maySign) return el("p", { class: "how" }, "Not signed.");
  const who = nameField("signer", campaign.operator);
  const status = el("p", { class: "how", role: "status" });
  const wrong = el("p", { class: "wrong", role: "alert" });
  const button = el("button", { type: "submit", class: "main" }, `Sign: ${verdict}`);
  async function sign(event) {
    event.preventDefault();
    if (!who.reportValidity()) return;
    button.disabled = true;
    say(wrong, "");
    say(status, "Signing: the report is written again, with the name of the signer …");
    try {
      await change("POST", campaignPath(campaign.id, "/sign"), { body: { verdict, who: who.value.trim() } });
      done();
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      say(status, "");
      say(wrong, `Not signed: ${error.message}.`);
      button.disabled = false;
    }
  }
  const says = `The key of the laboratory signs report and recording: ${verdict} for unit ${campaign.unit}.`;
  return el(
    "form",
    { class: "sign", novalidate: true, onsubmit: sign },
    el("p", {}, el("b", {}, "Not signed. "), says),
    el("label", { for: "signer" }, "Your name ", who),
    button,
    status,
    wrong,
  );
}

function signature({ says, problems }) {
  return el(
    "div",
    { class: `sign ${problems.length ? "bad" : "good"}` },
    says && el("p", {}, el("b", {}, `${says[0].toUpperCase()}${says.slice(1)}`)),
    problems.map((problem) => el("p", { class: "wrong" }, problem)),
  );
}
