// Who is looking: the session, begun by a token from the address or from the form, and its end.

import { ApiError, change, get, useCsrf } from "./api.js";
import { el, fill, say } from "./dom.js";

/**
 * The session: `role` is "viewer", "operator", "releaser", or "" without a session; `mayOperate`: may answer and stop
 * runs, `mayStart`: may start runs here, `maySign`: may sign acceptances here.
 */
export const session = { role: "", mayOperate: false, mayStart: false, maySign: false };

/** Set while there is a session: who has none is asked for a token at once, not after a refusal. */
const KNOWN = "benchctl-session";
const NAME = "benchctl-name";

/** Whether the address is a token, as `benchctl serve` prints it, and not the address of a view. */
export function isTokenInAddress() {
  return location.hash.length > 1 && !location.hash.startsWith("#/");
}

/** The token in the address, which it is removed from at once; empty where there is none. */
export function takeToken() {
  if (!isTokenInAddress()) return "";
  const token = location.hash.slice(1);
  history.replaceState(null, "", `${location.pathname}#/`);
  return token;
}

/** Begin a session with a token, or go on with the cookie's; an ApiError where neither is the server's. */
export async function begin(token) {
  if (token) await logIn(token);
  else if (localStorage.getItem(KNOWN)) accept(await get("/api/session"));
}

async function logIn(token) {
  accept(await change("POST", "/api/session", { token }));
}

/** End the session on the server and here. */
export async function logOut() {
  await change("DELETE", "/api/session");
  forget();
}

/** The session is over. */
export function forget() {
  session.role = "";
  localStorage.removeItem(KNOWN);
  sessionStorage.removeItem(NAME);
  useCsrf("");
}

/** The form that takes a token; `says` is why it is asked for, `done` is called once there is a session. */
export function loginForm(root, says, done) {
  const input = el("input", {
    id: "token",
    type: "password",
    autocomplete: "off",
    spellcheck: "false",
    required: true,
  });
  const wrong = el("p", { class: "wrong", role: "alert" });
  const button = el("button", { type: "submit", class: "main" }, "Log in");
  async function submit(event) {
    event.preventDefault();
    button.disabled = true;
    try {
      await logIn(input.value.trim());
      done();
    } catch (error) {
      say(wrong, refusal(error));
      input.select();
    } finally {
      button.disabled = false;
    }
  }
  fill(
    root,
    el(
      "form",
      { class: "login", onsubmit: submit },
      el("h1", {}, "Log in"),
      says && el("p", { class: "wrong", role: "alert" }, says),
      el("p", {}, "Paste the token that ", el("code", {}, "benchctl serve"), " printed when it started."),
      el("label", { for: "token" }, "Token"),
      input,
      wrong,
      button,
    ),
  );
  input.focus();
}

/** Why nobody is logged in, in words; empty where nothing went wrong. */
export function refusal(error) {
  if (!(error instanceof ApiError)) throw error;
  if (error.status === 401 || error.status === 403) {
    return "This token is not the server's. It has a new one each time it starts: copy it from there.";
  }
  return error.status === 0 ? "The server does not answer. Is benchctl serve still running?" : error.message;
}

/** The name that was given last in this window, or null. */
export function givenName() {
  return sessionStorage.getItem(NAME) || null;
}

/** A field for the name that the journal states, as it was given last in this window; `usual` is the lab's. */
export function nameField(id, usual) {
  const input = el("input", {
    id,
    maxlength: 60,
    autocomplete: "off",
    spellcheck: "false",
    required: true,
    onchange: () => sessionStorage.setItem(NAME, input.value.trim()),
  });
  input.value = givenName() ?? usual;
  return input;
}

function accept({ role, csrf, may_start: mayStart, may_sign: maySign }) {
  Object.assign(session, { role, mayOperate: role !== "viewer", mayStart, maySign });
  localStorage.setItem(KNOWN, "1");
  useCsrf(csrf);
}
