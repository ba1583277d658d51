// Looking into a recording: a window of bench time that is dragged, turned and typed, down to single samples.

import { ApiError } from "./api.js";
import { decimals } from "./axes.js";
import { el, fill, say } from "./dom.js";
import { clock, count, duration, percent } from "./format.js";
import { gestures } from "./gestures.js";
import { onKeys } from "./keys.js";
import { Panel } from "./plots.js";

const LEAST_S = 2e-4;
const IN = 0.5;
const OUT = 2;
const PAN = 0.25;
const AGAIN_MS = 700;
const MOST_PIXELS = 4000;

/**
 * Panels of channels over one window.
 *
 * `view(channel, from_s, to_s, pixels, signal)` gives a series as the server does; `moved(from_s, to_s)` is told of
 * each new window, `drawn-ms` on the root says how long the last one took until it was drawn.
 */
export class Zoom {
  constructor(place, { end_s, view, moved = () => {}, marks = [], signal }) {
    Object.assign(this, {
      end_s: Math.max(end_s, LEAST_S),
      view,
      moved,
      marks,
      signal,
      panels: [],
      before: [],
      asking: null,
    });
    this.from_s = 0;
    this.to_s = this.end_s;
    this.how = el("p", { class: "how", role: "status" });
    this.span = el("span", { class: "span" });
    this.plots = el("div", { class: "plots" });
    this.root = el("section", { class: "zoom", "aria-label": "plots" }, this.bar(), this.plots, this.how);
    place.append(this.root);
    gestures(this.plots, this, signal);
    this.keys();
  }

  /** Draw these panels: lists of channels `{name, label}` of one unit each. */
  draw(panels) {
    this.panelsLeft?.abort();
    this.panelsLeft = new AbortController();
    const signal = AbortSignal.any([this.signal, this.panelsLeft.signal]);
    fill(this.plots);
    this.panels = panels.map(
      (one) =>
        new Panel(this.plots, {
          ...one,
          marks: this.marks,
          signal,
          onSelect: (from_s, to_s) => this.go(from_s, to_s),
        }),
    );
    this.load(0);
  }

  /** Go to a window; it is remembered, so that `back` returns. */
  go(from_s, to_s, { remember = true, pause_ms = 0 } = {}) {
    const width = Math.min(this.end_s, Math.max(LEAST_S, to_s - from_s));
    const from = Math.min(Math.max(0, (from_s + to_s - width) / 2), this.end_s - width);
    if (remember) this.before.push([this.from_s, this.to_s]);
    [this.from_s, this.to_s] = [from, from + width];
    this.moved(this.from_s, this.to_s);
    for (const panel of this.panels) panel.show(this.from_s, this.to_s);
    this.load(pause_ms);
  }

  /** Zoom by a factor about an instant, the middle of the window where none is given. */
  by(factor, about_s = (this.from_s + this.to_s) / 2, options = {}) {
    this.go(about_s - (about_s - this.from_s) * factor, about_s + (this.to_s - about_s) * factor, options);
  }

  /** Move by a share of the window. */
  pan(share, options = {}) {
    const by_s = Math.min(this.end_s - this.to_s, Math.max(-this.from_s, share * (this.to_s - this.from_s)));
    this.go(this.from_s + by_s, this.to_s + by_s, options);
  }

  /** All of it. */
  reset() {
    this.go(0, this.end_s);
  }

  /** The window before this one. */
  back() {
    if (this.before.length) this.go(...this.before.pop(), { remember: false });
  }

  async load(pause_ms) {
    this.asking?.abort();
    clearTimeout(this.again);
    const asking = new AbortController();
    this.asking = asking;
    const began = performance.now();
    if (pause_ms) await new Promise((done) => setTimeout(done, pause_ms));
    if (asking.signal.aborted || this.signal.aborted || !this.panels.length) return;
    const signal = AbortSignal.any([asking.signal, this.signal]);
    const [from_s, to_s] = [this.from_s, this.to_s];
    const pixels = Math.min(MOST_PIXELS, this.panels[0].pixels);
    this.root.setAttribute("aria-busy", "true");
    try {
      const channels = this.panels.flatMap((panel) => panel.channels);
      const replies = await Promise.all(
        channels.map(({ name, of }) => this.view(of ?? name, from_s, to_s, pixels, signal)),
      );
      const series = new Map(
        channels.map(({ name }, index) => [name, { ...replies[index], pixel_s: (to_s - from_s) / pixels }]),
      );
      for (const panel of this.panels) panel.show(from_s, to_s, series);
      this.tell(channels, replies, pixels);
      this.root.setAttribute("aria-busy", "false");
      requestAnimationFrame(() => (this.root.dataset.drawnMs = (performance.now() - began).toFixed(1)));
    } catch (error) {
      if (signal.aborted) return;
      if (!(error instanceof ApiError)) throw error;
      say(this.how, error.status === 0 ? "Waiting for the server." : error.message);
      if (error.status === 0) this.again = setTimeout(() => this.load(0), 1000);
    }
  }

  tell(channels, replies, pixels) {
    const window_s = this.to_s - this.from_s;
    const places = Math.max(0, decimals(window_s / 200));
    say(this.span, `${clock(this.from_s, places)} to ${clock(this.to_s, places)} (${duration(window_s)})`);
    const said = new Map();
    replies.forEach((reply, index) => {
      const how = howDrawn(reply, pixels);
      said.set(how, [...(said.get(how) ?? []), channels[index].label]);
    });
    say(this.how, [...said].map(([how, labels]) => `${labels.join(", ")}: ${how}`).join(". "));
    if (replies.some((reply) => !reply.complete)) this.again = setTimeout(() => this.load(0), AGAIN_MS);
  }

  bar() {
    const button = (title, says, action) =>
      el("button", { type: "button", title: says, "aria-label": says, onclick: action }, title);
    return el(
      "div",
      { class: "bar" },
      this.span,
      el("span", { class: "gap" }),
      button("◀", "earlier", () => this.pan(-PAN)),
      button("▶", "later", () => this.pan(PAN)),
      button("+", "zoom in", () => this.by(IN)),
      button("−", "zoom out", () => this.by(OUT)),
      button("Back", "the window before", () => this.back()),
      button("All", "the whole recording", () => this.reset()),
    );
  }

  keys() {
    const bind = (keys, says, action) => onKeys(keys, says, action, this.signal);
    bind(["ArrowLeft"], "earlier", () => this.pan(-PAN));
    bind(["ArrowRight"], "later", () => this.pan(PAN));
    bind(["+", "="], "zoom in", () => this.by(IN));
    bind(["-"], "zoom out", () => this.by(OUT));
    bind(["Backspace"], "the window before", () => this.back());
    bind(["0", "Home"], "the whole recording", () => this.reset());
  }
}

function howDrawn({ exact, complete, done, samples }, pixels) {
  const making = complete
    ? ""
    : ` (the overview is being made: ${percent(done, 2)}; what is missing appears by itself)`;
  if (!samples && complete) return "no samples in this window";
  if (exact)
    return samples === 1 ? "exact: 1 sample" : `exact: each of the ${count(samples)} samples is its own point${making}`;
  return `minimum and maximum of ${count(samples / pixels)} samples a pixel, ${count(samples)} in all${making}`;
}
