// Whether the server answers. Whoever misses an answer says so here; it is then asked, ever more seldom, until it does.

const FIRST_S = 0.5;
const LONGEST_S = 10;

/** Tells `lost` (detail: when it is tried next), `trying`, `back`, and `stranger` where it does not know us any more. */
export const connection = new EventTarget();

let lost = false;
let timer = 0;
let wait_s = FIRST_S;

/** A request has failed without an answer: ask the server itself, and again until it answers. */
export function suspect() {
  if (lost) return;
  lost = true;
  wait_s = FIRST_S;
  ask();
}

/** Try at once, not at the end of the wait. */
export function tryNow() {
  if (!lost) return;
  wait_s = FIRST_S;
  ask();
}

/** Whether the server is out of reach just now. */
export function isLost() {
  return lost;
}

async function ask() {
  clearTimeout(timer);
  connection.dispatchEvent(new Event("trying"));
  let reply;
  try {
    reply = await fetch("/api/session", { cache: "no-store", signal: AbortSignal.timeout(5000) });
  } catch {
    connection.dispatchEvent(new CustomEvent("lost", { detail: { again_s: wait_s } }));
    timer = setTimeout(ask, 1000 * wait_s);
    wait_s = Math.min(2 * wait_s, LONGEST_S);
    return;
  }
  lost = false;
  connection.dispatchEvent(new Event("back"));
  if (reply.status === 401) connection.dispatchEvent(new Event("stranger"));
}
