// Starting a run: a released procedure, a unit, what `benchctl check` states of both, then the start.

import { ApiError, change, get } from "./api.js";
import { el, fact, fill, say } from "./dom.js";
import { count, duration } from "./format.js";
import { QueuePanel, newOrder } from "./queue.js";
import { link, go } from "./router.js";
import { nameField, session } from "./session.js";

/** The view of `#/start`. */
export async function startView(root, { signal }) {
  const { bench, operator, procedures } = await get("/api/released", {}, signal);
  if (!session.mayStart || !procedures.length)
    return void fill(
      root,
      el("p", { class: "nothing" }, "Nothing can be started here with this token."),
      el("p", {}, "How a lab sets it up: ", el("a", { href: link(["help", "live_page"]) }, "The live page"), "."),
    );
  const procedure = el(
    "select",
    { id: "procedure", onchange: changed },
    procedures.map(({ name, title }) => el("option", { value: name }, title)),
  );
  const about = el("p", { class: "how", id: "about" });
  const serial = el("input", {
    id: "serial",
    maxlength: 60,
    autocomplete: "off",
    spellcheck: "false",
    required: true,
    oninput: changed,
  });
  const who = nameField("who", operator);
  const check = el("button", { type: "submit" }, "Check");
  const outcome = el("div", { class: "outcome", role: "status" });
  const start = el("button", { type: "button", class: "main", disabled: true, onclick: begin }, "Start the run");
  const name = () => (who.reportValidity() ? who.value.trim() : "");
  const queue = new QueuePanel(signal, { who: name, changed: offer });
  let latest = null;
  let isOn = false;
  let isSending = false;
  const form = el(
    "form",
    { class: "start", novalidate: true, onsubmit: ask },
    el("label", { for: "procedure" }, "Procedure"),
    el("div", {}, procedure, about),
    el("label", { for: "serial" }, "Serial number of the unit"),
    el("div", { class: "row" }, serial, check),
    el("label", { for: "who" }, "Your name"),
    who,
    outcome,
    start,
  );
  let asked = 0;

  // What was checked is what is started: any change needs another check.
  function changed() {
    asked += 1;
    start.disabled = true;
    fill(outcome);
    const chosen = procedures.find(({ name }) => name === procedure.value);
    say(about, [chosen.says, extent(chosen)].filter(Boolean).join(" "));
  }

  // A scanner ends a number with Enter, which checks. It never starts: the focus stays where the next scan belongs.
  async function ask(event) {
    event.preventDefault();
    if (!serial.reportValidity()) return;
    changed();
    const number = asked;
    fill(outcome, el("p", { class: "how" }, "Checking the plan and identifying the instruments …"));
    serial.select();
    const found = await answered(() => change("POST", "/api/check", { body: order(), signal }));
    if (!found || number !== asked || signal.aborted) return;
    start.disabled = !found.ready;
    fill(outcome, found.ready ? can(found, isOn) : cannot("Cannot start.", found.problems));
  }

  // While a run is on the bench, or orders wait, a new order goes to the end of the queue.
  function offer(queue) {
    latest = queue;
    if (isSending) return;
    const before = isOn;
    isOn = queue.run?.fault === null || queue.waiting.length > 0;
    if (isOn !== before && outcome.firstChild) form.requestSubmit(); // check again what it is offered for now
    say(start, isOn ? "Put it in the queue" : "Start the run");
  }

  async function begin() {
    if (!name()) return;
    isSending = true;
    for (const one of [start, check]) one.disabled = true;
    fill(outcome, el("p", { class: "how" }, isOn ? "Queueing …" : "Starting: opening the instruments …"));
    const body = { ...order(), who: name(), order: newOrder() };
    const done = await answered(() => change("POST", isOn ? "/api/queue" : "/api/start", { body }));
    isSending = check.disabled = false;
    if (signal.aborted) return;
    if (!done) return void (latest && offer(latest));
    if (!isOn) return void go(["campaigns", done.id]);
    changed();
    queue.show(done);
    serial.value = "";
    serial.focus();
  }

  async function answered(request) {
    try {
      return await request();
    } catch (error) {
      if (signal.aborted) return null;
      if (!(error instanceof ApiError)) throw error;
      fill(outcome, cannot("Not started.", [error.message]));
      return null;
    }
  }

  function order() {
    return { procedure: procedure.value, serial: serial.value.trim() };
  }

  fill(
    root,
    el("div", { class: "title" }, el("h1", {}, "Start a run"), el("p", { class: "subtitle" }, `on ${bench}`)),
    queue.root,
    form,
  );
  changed();
  serial.focus();
}

function extent({ steps, bench_time_s, questions }) {
  if (bench_time_s === null) return "This bench cannot run it: the check says why.";
  const asks = questions ? `, ${count(questions)} ${questions === 1 ? "question" : "questions"} to you` : "";
  return `${count(steps)} steps, at least ${duration(bench_time_s)}${asks}.`;
}

function can(found, isQueued) {
  const title = isQueued ? "Can be queued, and is checked again when its turn comes: " : "Can start: ";
  return [
    el("p", { class: "answer good" }, el("b", {}, title), extent({ ...found, questions: 0 })),
    found.warnings.map((warning) => el("p", { class: "answer warn" }, el("b", {}, "Warning: "), warning)),
    found.questions.length > 0 && [
      el("p", {}, "During the run this page will ask you to:"),
      el(
        "ol",
        {},
        found.questions.map((question) => el("li", {}, question)),
      ),
    ],
    el("dl", { class: "facts" }, fact("Instruments", found.instruments.join(", "))),
    !isQueued && el("p", {}, "The table will move and the chamber will change its temperature. Is everybody clear of them?"),
  ];
}

function cannot(title, problems) {
  return el(
    "div",
    { class: "answer bad" },
    el("p", {}, el("b", {}, title)),
    problems.map((problem) => el("p", {}, problem)),
  );
}
