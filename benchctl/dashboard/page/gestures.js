// The wheel and fingers on plots: wheel zooms about the pointer, with Shift it pans; one finger pans, two pinch.

const TURN = 0.0018;

/** What turns and moves come in is small and many: each is drawn at once, and loaded when they pause. */
const TURNING = { remember: false, pause_ms: 40 };

/** Let wheel and fingers over `place` move a `Zoom`. */
export function gestures(place, zoom, signal) {
  const fingers = new Map();

  function instantAt(clientX) {
    const over = zoom.panels[0].chart.over.getBoundingClientRect();
    const share = Math.min(1, Math.max(0, (clientX - over.left) / over.width));
    return zoom.from_s + share * (zoom.to_s - zoom.from_s);
  }

  place.addEventListener(
    "wheel",
    (event) => {
      if (!event.target.closest(".u-over")) return;
      event.preventDefault();
      const turned = Math.abs(event.deltaX) > Math.abs(event.deltaY) ? event.deltaX : event.deltaY;
      const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1;
      if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY))
        zoom.pan(turned * lines * TURN * 0.5, TURNING);
      else zoom.by(Math.exp(turned * lines * TURN), instantAt(event.clientX), TURNING);
    },
    { passive: false, signal },
  );

  place.addEventListener("dblclick", (event) => event.target.closest(".u-over") && zoom.reset(), { signal });

  place.addEventListener(
    "pointerdown",
    (event) => {
      if (event.pointerType === "touch" && event.target.closest(".u-over")) fingers.set(event.pointerId, event.clientX);
    },
    { signal },
  );

  place.addEventListener(
    "pointermove",
    (event) => {
      if (!fingers.has(event.pointerId)) return;
      const before = [...fingers.values()];
      fingers.set(event.pointerId, event.clientX);
      const now = [...fingers.values()];
      const width = zoom.panels[0].pixels;
      if (now.length === 1) zoom.pan((before[0] - now[0]) / width, TURNING);
      else if (now.length === 2) {
        const [was, is] = [Math.abs(before[0] - before[1]), Math.abs(now[0] - now[1])];
        if (was > 10 && is > 10) zoom.by(was / is, instantAt((now[0] + now[1]) / 2), TURNING);
      }
    },
    { signal },
  );

  for (const name of ["pointerup", "pointercancel"]) {
    addEventListener(name, (event) => fingers.delete(event.pointerId), { signal });
  }
}
