// Requests to the server: JSON both ways, the session's cookie by itself, its CSRF word on whatever changes something.

import { connection, suspect } from "./connection.js";

/** What the server refused: its one line and its status; status 0: no answer at all. */
export class ApiError extends Error {
  constructor(status, message) {
    super(message);
    this.status = status;
  }
}

let csrf = "";

/** The word that the session's changes are sent with. */
export function useCsrf(word) {
  csrf = word;
}

/** GET a resource; `query` values that are null are left out. */
export function get(path, query = {}, signal = null) {
  const present = Object.entries(query).filter(([, value]) => value !== null && value !== undefined);
  const asked = new URLSearchParams(present).toString();
  return request("GET", asked ? `${path}?${asked}` : path, { signal });
}

/** POST or DELETE; `token` instead of the session's cookie. */
export function change(method, path, { body = null, token = null, signal = null } = {}) {
  return request(method, path, { body, token, signal });
}

/** Do what a server out of reach may refuse: the banner shows that it is away. */
export async function unlessAway(action, signal) {
  try {
    await action();
  } catch (error) {
    if (!signal.aborted && !(error instanceof ApiError)) throw error;
  }
}

/** Repeat such an action until the view ends, except while the page is hidden. */
export function repeat(action, everyMs, signal) {
  const timer = setInterval(() => document.hidden || unlessAway(action, signal), everyMs);
  signal.addEventListener("abort", () => clearInterval(timer));
}

/** The path of a campaign's resource. */
export function campaignPath(id, rest = "") {
  return `/api/campaigns/${encodeURIComponent(id)}${rest}`;
}

async function request(method, path, { body = null, token = null, signal = null }) {
  const headers = {};
  if (token !== null) headers.Authorization = `Bearer ${token}`;
  if (method !== "GET" && csrf) headers["X-CSRF"] = csrf;
  if (body !== null) headers["Content-Type"] = "application/json";
  const reply = await answered(path, {
    method,
    headers,
    body: body && JSON.stringify(body),
    cache: "no-store",
    signal,
  });
  const said = await reply.json().catch((error) => {
    if (signal?.aborted) throw error; // whoever asked has left before the answer was read
    return {};
  });
  if (reply.ok) return said;
  if (reply.status === 401 && token === null && path !== "/api/session")
    connection.dispatchEvent(new Event("stranger"));
  throw new ApiError(reply.status, said.error || `the server answered ${reply.status}`);
}

// A server that is busy for the moment (503) says after how many seconds to ask again; only reading is repeated.
async function answered(path, options, tries = 10) {
  let reply;
  try {
    reply = await fetch(path, options);
  } catch (error) {
    if (options.signal?.aborted) throw error;
    suspect();
    throw new ApiError(0, "the server does not answer");
  }
  const wait_s = Number(reply.headers.get("Retry-After"));
  if (reply.status !== 503 || !wait_s || options.method !== "GET" || tries <= 1) return reply;
  await new Promise((resolve) => setTimeout(resolve, 1000 * wait_s));
  options.signal?.throwIfAborted();
  return answered(path, options, tries - 1);
}
