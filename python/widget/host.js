// What the widgets of a notebook share: their place in a cell, and what Python hears of the light.

import style from "../../src/document/output/page/style.css";
import own from "./widget.css";

/** Milliseconds without a change until Python hears of it. */
export const REST = 250;

/** A root for a page in a cell; neither style nor keys are shared with the notebook. */
export function hosted(el) {
  const host = document.createElement("div"), sheet = document.createElement("style"), root = document.createElement("div");
  host.setAttribute("data-lm-suppress-shortcuts", "true");
  // As narrow as the cell, and not as the window.
  sheet.textContent = style.replaceAll("@media (max-width: 860px)", "@container (max-width: 680px)") + own;
  host.attachShadow({ mode: "open" }).append(sheet, root);
  el.append(host);
  return root;
}

/** Bytes of a binary trait. */
export const bytesOf = (view) => new Uint8Array(view.buffer, view.byteOffset, view.byteLength);

/** Notes light, hand and pixel of a page with these positions in the traits of a model. */
export function noteLight(model, { state, mix }, positions) {
  model.set("hand", [...state.hand]);
  model.set("picked", state.pixel ? [...state.pixel] : []);
  model.set("_mix", mix.map(({ light, weight, position }) => [light.spectrum, weight, positions[position]]));
}

/** Moves the hand of a page to that of the model. */
export function takeHand(model, shown) {
  const asked = model.get("hand");
  if (String(asked) !== String(shown.state.hand)) shown.set({ by: "dial", hand: [...asked] });
}

/** Hears changes of traits and messages of a model; returns what ends it. */
export function heard(model, acts) {
  for (const [event, act] of Object.entries(acts)) model.on(event, act);
  return () => { for (const [event, act] of Object.entries(acts)) model.off(event, act); };
}
