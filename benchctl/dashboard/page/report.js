// The stored report of a document, whole, in a frame of its own that may run nothing.

import { campaignPath } from "./api.js";
import { el } from "./dom.js";

/** A button that opens the full report of a kind of document below it, and closes it again. */
export function fullReport(campaign, kind) {
  const place = el("div", {});
  const title = `The full ${kind} report of ${campaign.name}`;
  const source = campaignPath(campaign.id, `/documents/${kind}/report`);
  const button = el("button", { type: "button", "aria-expanded": "false", onclick: toggle }, "Open the full report");
  function toggle() {
    const open = !place.firstChild;
    place.replaceChildren(...(open ? [el("iframe", { sandbox: "", src: source, title, class: "report" })] : []));
    button.textContent = open ? "Close the full report" : "Open the full report";
    button.setAttribute("aria-expanded", String(open));
  }
  const print = el("a", { href: source, target: "_blank", rel: "noopener" }, "To print it, open it in a new window");
  return el("div", {}, el("div", { class: "buttons" }, button, print), place);
}
