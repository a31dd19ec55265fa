// The live widget of a notebook (anywidget): the page of Relume, lit in the browser, whose camera Python moves by a march.
// docs/PAGE.md describes it; scripts/page_script makes relume/widget.js of it.

import { mount } from "../../src/document/output/page/relume.js";
import { bytesOf, heard, hosted, noteLight, REST, takeHand } from "./host.js";

/** Degrees of a drag as long as the picture is high, and of a key; growth by a step of the wheel or a key: as in the window. */
const TURN = 180, KEY_TURN = 5, NEARER = 1.1;
/** Pixels of a scroll that count as a step of the wheel. */
const STEP = 50;

/** What must agree for a page to take the place of another one. */
const lightsOf = ({ lights, positions, dial, model, components }) => JSON.stringify([lights.map(({ name }) => name), positions, dial, !model, components?.map(({ name }) => name)]);

/** Calls `move(kind, …numbers)` for drags, wheel and keys on `frame`, and keeps them from its page where they move the camera. */
function listenTo(frame, isPicked, move) {
  let at = null;
  const listen = (type, act, options) => frame.addEventListener(type, act, options);
  listen("contextmenu", (event) => event.preventDefault());
  listen("pointerdown", (event) => {
    at = [event.clientX, event.clientY];
    frame.setPointerCapture(event.pointerId);
  });
  listen("pointermove", (event) => {
    if (!at || !event.buttons) return;
    const [right, down] = [event.clientX - at[0], event.clientY - at[1]].map((pixels) => pixels / frame.clientHeight);
    if (!right && !down) return;
    at = [event.clientX, event.clientY];
    if (event.shiftKey || event.buttons > 1) move("pan", right, -down);
    else if (event.ctrlKey || event.metaKey) move("roll", TURN * right);
    // The volume follows the pointer, so the camera moves the opposite way.
    else move("orbit", -TURN * right, TURN * down);
  });
  for (const type of ["pointerup", "pointercancel"]) listen(type, () => { at = null; });
  listen("wheel", (event) => {
    event.preventDefault();
    move("dolly", NEARER ** (-event.deltaY * (event.deltaMode ? 16 : 1) / STEP));
  }, { passive: false });
  listen("keydown", (event) => {
    const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    const nearer = { "+": 1, "=": 1, PageUp: 1, "-": -1, PageDown: -1 }[event.key], roll = { ".": 1, ",": -1 }[event.key];
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (arrow && !isPicked()) {
      if (event.shiftKey) move("pan", ...arrow.map((part) => -0.05 * part));
      else move("orbit", ...arrow.map((part) => KEY_TURN * part));
    } else if (nearer) move("dolly", NEARER ** nearer);
    else if (roll) move("roll", KEY_TURN * roll);
    else if (event.key === "r" || event.key === "R") move("reset");
    else return;
    event.preventDefault();
  });
}

function render({ model, el }) {
  const root = hosted(el), pageNow = () => JSON.parse(model.get("_page")), views = () => model.get("_views");
  let shown, lights, positions, later = 0, moves = [], frame = 0;
  const told = () => { noteLight(model, shown, positions); model.save_changes(); };
  const changed = () => { clearTimeout(later); later = setTimeout(told, REST); };
  /** Movements since the last message, at most one for each picture of the browser. */
  const move = (kind, ...numbers) => {
    const last = moves.at(-1);
    if (last?.[0] === kind && kind !== "reset") numbers.forEach((part, n) => { last[n + 1] = kind === "dolly" ? last[n + 1] * part : last[n + 1] + part; });
    else moves.push([kind, ...numbers]);
    frame ||= requestAnimationFrame(() => { frame = 0; model.send({ moves }); moves = []; });
  };
  const show = () => {
    const page = pageNow(), all = views(), bytes = (view) => bytesOf(all[view]);
    const now = lightsOf(page);
    if (now === lights) return shown.replace(page, bytes);
    shown?.end();
    lights = now;
    ({ positions } = page);
    shown = mount(root, page, bytes, { changed, hint: "Drag to turn; Shift and drag to move; scroll to come nearer. " });
    listenTo(root.querySelector(".frame"), () => shown.state.pixel, move);
    told();
  };
  show();
  const end = heard(model, {
    "change:_page": show,
    "change:hand": () => takeHand(model, shown),
    "msg:custom": ({ error }) => { root.querySelector(".status").textContent = error ?? ""; },
  });
  return () => {
    end();
    cancelAnimationFrame(frame);
    clearTimeout(later);
    shown.end();
  };
}

export default { render };
