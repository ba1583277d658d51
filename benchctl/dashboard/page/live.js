// A campaign that runs: where it is in its plan, what is measured, how near the limits are, and the way to stop it.

import { campaignPath, get, repeat } from "./api.js";
import * as banners from "./banners.js";
import { el, fill, say } from "./dom.js";
import { appendEvents } from "./events.js";
import { clock, count, duration, fixed, joined, moment, number } from "./format.js";
import { onKeys } from "./keys.js";
import { Panel } from "./plots.js";
import { Prompt } from "./prompt.js";
import { queueNow } from "./queue.js";
import { Limits, Readings } from "./readings.js";
import { go } from "./router.js";
import { session } from "./session.js";
import { Feed } from "./socket.js";
import { statusChip } from "./status.js";
import { askToStop } from "./stop.js";
import { Timeline, kindName } from "./timeline.js";

const PANELS = [
  {
    unit: "°C",
    title: "temperature, °C",
    least: 0.5,
    height: 136,
    channels: [
      { name: "setpoint_c", label: "set point", width: 3.5, stepped: true },
      { name: "air_c", label: "chamber air" },
      { name: "gyro_c", label: "gyro" },
    ],
  },
  { unit: "°/s", title: "rate, °/s", least: 1, height: 118, channels: [{ name: "rate_dps", label: "table" }] },
  { unit: "V", title: "output, V", height: 118, channels: [{ name: "gyro_v", label: "gyro" }] },
];
const ALL_S = 1e9;
const ROOM = 1.1;
const WINDOWS = [
  [60, "1 min"],
  [600, "10 min"],
  [3600, "1 h"],
  [ALL_S, "all"],
];
const KEPT = "benchctl-window";
const AFTER_SILENCE =
  "The run looks after a silent instrument itself: it starts the stream anew, or stops and makes the bench safe. " +
  "Look at the events, then at the bench.";
const MOVED_ON_MS = 1500;
const ENDED_SHOWN_MS = 20000;

/** The view of a campaign's live page. */
export function liveView(body, { campaign, signal }) {
  new LivePage(body, campaign, signal);
}

class LivePage {
  constructor(body, campaign, signal) {
    Object.assign(this, { campaign, signal, heard: performance.now(), message: null, stopAsked: null });
    this.window_s = Number(localStorage.getItem(KEPT)) || WINDOWS[1][0];
    this.where = el("p", { class: "where" });
    this.progress = el("progress", { max: 1, value: 0, "aria-label": "bench time done" });
    this.waits = el("p", { class: "waits", role: "status", hidden: true });
    this.ends = el("p", { class: "ends" });
    this.age = el("span", { class: "age" });
    this.readings = new Readings();
    this.limits = new Limits();
    this.prompt = new Prompt(campaign);
    this.events = el("ol", { class: "events", "aria-label": "events", tabindex: "0" });
    const plan = el("section", { class: "plan", "aria-label": "plan" });
    const plots = el("section", { class: "plots", "aria-label": "measured" });
    this.stop =
      session.mayOperate &&
      el("button", { type: "button", class: "danger", onclick: () => this.ask() }, "Stop …");
    fill(
      body,
      this.prompt.root, // first, so that nothing above it changes its height while a button is held
      el("div", { class: "doing" }, el("div", {}, this.where, this.waits, this.progress, this.ends), this.stop),
      plan,
      el(
        "div",
        { class: "columns" },
        plots,
        el(
          "aside",
          {},
          this.readings.root,
          el("h2", {}, "Limits"),
          this.limits.root,
          el("h2", {}, "Events"),
          this.events,
        ),
      ),
    );
    this.plan = campaign.plan.map((step) => ({ ...step }));
    const spans = this.plan.length ? this.plan : campaign.steps.map((step) => ({ ...step, label: step.name }));
    this.timeline = new Timeline(plan, spans, { signal });
    plots.append(this.windowChoice());
    this.panels = PANELS.map((about) => new Panel(plots, { ...about, signal }));
    this.feed = new Feed(campaign.id, (message) => this.take(message), signal);
    this.watch();
    addEventListener("resize", () => this.watch(), { signal });
    const ticking = setInterval(() => this.tellAge(), 500);
    signal.addEventListener("abort", () => clearInterval(ticking));
    if (this.stop) onKeys(["s"], "stop the run (asks first)", () => this.ask(), signal);
  }

  watch() {
    const channels = PANELS.flatMap((panel) => panel.channels.map(({ name }) => name));
    this.watched_s = this.window_s < ALL_S ? this.window_s : ROOM * Math.max(60, this.message?.now_s ?? 0);
    this.feed.watch({ channels, window_s: this.watched_s, pixels: Math.min(2000, this.panels[0].pixels) });
  }

  take(message) {
    this.message = message;
    this.heard = performance.now();
    this.tellStatus(message.status);
    this.tellWhere(message);
    this.tellSoak(message.soak);
    this.prompt.show(message.question);
    this.readings.show(message.values, message.noise_says);
    this.limits.show(message.limits);
    appendEvents(this.events, message.events);
    this.safe = message.events.findLast(({ kind }) => kind === "safe")?.says ?? this.safe;
    this.timeline.showNow(message.now_s, this.plan.length ? scheduled(this.plan, message) : null);
    this.draw(message);
    this.warn(message);
    this.tellAge();
    if (message.status !== "running" && message.status !== "died") this.ended(message);
  }

  draw({ now_s, series = {} }) {
    if (now_s > this.watched_s && this.window_s === ALL_S) this.watch();
    const named = Object.entries(series);
    const lines = named.length ? new Map(named.map(([name, one]) => [name, drawn(one)])) : null;
    const from_s = Math.max(0, now_s - this.watched_s);
    for (const panel of this.panels) panel.show(from_s, Math.max(now_s, from_s + 1), lines);
  }

  tellWhere({ step, doing, left_s, ends_utc, now_s, status, samples }) {
    const place = step && `Step ${step.index} of ${step.count}: ${step.label}`;
    const planned = this.plan.find(({ index }) => index === step?.index);
    const told = [doing, step?.kind && kindName(step.kind), inStep(step, planned, now_s)].filter(Boolean).join(" · ");
    fill(this.where, el("b", {}, place || status), told && ` · ${told}`);
    this.progress.hidden = left_s === null;
    this.progress.value = left_s === null ? 0 : now_s / Math.max(1e-9, now_s + left_s);
    const ends = ends_utc && moment(ends_utc, { withSeconds: left_s < 600, withDate: left_s > 43200 });
    const total_s = Math.round(now_s + left_s); // the three figures add up as they are shown
    const parts = [
      left_s === null ? `bench time ${clock(now_s)}` : `bench time ${clock(now_s)} of ${clock(total_s)}`,
      left_s !== null && `${clock(total_s - Math.round(now_s))} left`,
      left_s !== null && this.plan.length > 0 && besidePlan(total_s, this.plan.at(-1).t_end_s),
      ends && el("span", {}, "ends about ", ends),
      `${count(samples)} samples`,
      this.age,
    ].filter(Boolean);
    fill(
      this.ends,
      parts.flatMap((part, index) => (index ? [" · ", part] : [part])),
    );
  }

  tellSoak(soak) {
    this.waits.hidden = !soak;
    if (soak) say(this.waits, waitsFor(soak));
  }

  tellStatus(status) {
    if (status === this.status) return;
    this.status = status;
    document.querySelector("h1 + .chip")?.replaceWith(statusChip(status));
  }

  tellAge() {
    if (!this.message) return;
    const age_s = this.message.data_age_s + (performance.now() - this.heard) / 1000;
    say(this.age, `last data ${duration(age_s < 1 ? Math.round(10 * age_s) / 10 : age_s)} ago`);
    this.age.classList.toggle("old", this.message.stalled || age_s > 10);
  }

  warn({ died, stalled, says, stop_asked: stopAsked, status }) {
    if (died) banners.show("run", "bad", el("b", {}, "The runner has died."), ...this.afterDeath());
    else if (stalled) banners.show("run", "bad", [el("b", {}, "No data arrive any more: "), says], AFTER_SILENCE);
    else if (says && status === "running") banners.show("run", "warn", says);
    else banners.hide("run");
    if (this.stop) this.stop.hidden = status !== "running";
    if (stopAsked) this.tellStop();
  }

  afterDeath() {
    const { name, procedure } = this.campaign;
    return [
      "The guard that runs beside it brings table and chamber to rest: the events say whether it did.",
      ["Then, in the folder of the campaigns, close the recording: ", banners.command(`benchctl recover ${name}`)],
      [
        "and go on where it stopped, with the bench of the first run: ",
        banners.command(`benchctl run ${procedure} --resume ${name} --bench …`),
      ],
    ];
  }

  ask() {
    if (this.message?.status === "running" && !this.message.died)
      askToStop(this.campaign, (date) => ((this.stopAsked = date), this.tellStop()));
  }

  tellStop() {
    const asked = this.stopAsked
      ? ["Stop was asked for at ", moment(this.stopAsked.toISOString(), { withSeconds: true, withDate: false }), ". "]
      : "Stop has been asked for. ";
    banners.show(
      "stop",
      "warn",
      [asked, "The table comes to rest, then the chamber goes to its safe set point."].flat(),
    );
    if (this.stop) this.stop.disabled = true;
  }

  ended({ status }) {
    banners.hide("stop");
    const after_s = this.stopAsked && (Date.now() - this.stopAsked) / 1000;
    banners.show("ended", status === "complete" ? "good" : "warn", [
      el("b", {}, `The run has ended: ${status}`),
      this.stopAsked ? `, ${duration(after_s)} after Stop was asked for.` : ".",
      this.safe ? ` The bench is ${this.safe}.` : "",
    ]);
    repeat(() => this.moveOn(), MOVED_ON_MS, this.signal);
    setTimeout(() => banners.hide("ended"), ENDED_SHOWN_MS);
  }

  // A run that is judged by limits goes on computing its verdict after its end, and the queue still has it.
  async moveOn() {
    const { run } = await queueNow(this.signal);
    if (run?.campaign === this.campaign.id && run.fault === null) {
      fill(this.where, el("b", {}, "The verdict is being computed …"));
      return;
    }
    const { has } = await get(campaignPath(this.campaign.id), {}, this.signal);
    go(["campaigns", this.campaign.id, has.acceptance ? "acceptance" : "plots"]);
  }

  windowChoice() {
    const radios = WINDOWS.map(([seconds, name], index) => {
      const radio = el("input", {
        type: "radio",
        name: "window",
        id: `window-${index}`,
        value: seconds,
        onchange: () => this.choose(seconds),
      });
      radio.checked = seconds === this.window_s;
      return [radio, el("label", { for: `window-${index}` }, name)];
    });
    return el("fieldset", { class: "choice" }, el("legend", {}, "Window of bench time"), radios);
  }

  choose(seconds) {
    this.window_s = seconds;
    localStorage.setItem(KEPT, seconds);
    this.watch();
  }
}

function inStep(step, planned, now_s) {
  if (!Number.isFinite(step?.ends_s) || !planned) return "";
  const left_s = step.ends_s - now_s;
  const late_s = step.ends_s - step.began_s - (planned.t_end_s - planned.t_start_s);
  const late = late_s >= 1 && `${duration(late_s)} longer than planned`;
  return [left_s >= 0.5 && `${duration(left_s)} left in it`, late].filter(Boolean).join(", ");
}

/** How the bench time that the campaign will take compares with its plan. */
function besidePlan(total_s, planned_s) {
  const late_s = total_s - planned_s;
  if (Math.abs(late_s) < 1) return `as planned`;
  return `${duration(Math.abs(late_s))} ${late_s > 0 ? "longer" : "shorter"} than planned (${clock(planned_s)})`;
}

/** The plan in bench time: steps that have begun as they were, those to come as they are expected. */
function scheduled(plan, { step, now_s, left_s }) {
  const place = plan.findIndex(({ index }) => index === step?.index);
  if (step && place >= 0) plan[place].began_s = step.began_s;
  const later_s = left_s === null ? 0 : now_s + left_s - plan.at(-1).t_end_s;
  return plan.map((planned, number) => {
    if (number > place)
      return { ...planned, t_start_s: planned.t_start_s + later_s, t_end_s: planned.t_end_s + later_s };
    const t_start_s = planned.began_s ?? planned.t_start_s;
    const t_end_s = number === place ? step.ends_s : (plan[number + 1].began_s ?? planned.t_end_s);
    return { ...planned, t_start_s, t_end_s: Math.max(t_start_s, t_end_s) };
  });
}

/** What a soak waits for: the chamber, then that it stays there long enough, then the gyro. */
function waitsFor(soak) {
  const [air, there] = [fixed(soak.air_c, 2), fixed(soak.setpoint_c, 1)];
  const within = `within ±${joined(number(soak.tolerance_c), "°C")}`;
  const drift = `gyro drifts by ${joined(fixed(soak.drift_c_per_min, 3), "°C/min")}`;
  const most = `at most ${joined(number(soak.most_drift_c_per_min), "°C/min")} is allowed`;
  const hold = duration(soak.hold_s);
  if (soak.held_s === null)
    return `Waiting for the chamber: air ${air} → ${there} °C, then ${hold} ${within}; ${drift}, ${most}.`;
  const held = `air ${air}, set point ${there} °C: ${within} for ${duration(Math.floor(soak.held_s))}`;
  if (soak.left_s > 0)
    return `Soaking: ${held} of ${hold}, ${duration(Math.ceil(soak.left_s))} left; ${drift}, ${most}.`;
  return `Waiting for the gyro: ${drift}, ${most}; ${held}, ${hold} needed.`;
}

/** A series as panels take it: exact where no pixel holds more than one value. */
function drawn(series) {
  const exact = series.low.every((low, index) => low !== null && low === series.high[index]);
  const pixel_s = exact || series.t_s.length < 3 ? null : series.t_s.at(-1) - series.t_s.at(-2);
  return { ...series, exact, pixel_s };
}
