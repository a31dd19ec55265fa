// The widget of a notebook whose browser marches the volume (anywidget): a live page whose camera, crop box and densities Python shares.
// docs/PAGE.md describes it; scripts/page_script makes relume/live.js of it.

import { cutIn, densitiesIn, digits, inFile, inflated, inPage, open, seenIn } from "../../src/document/output/page/live.js";
import { mount } from "../../src/document/output/page/relume.js";
import { bytesOf, heard, hosted, noteLight, REST, takeHand } from "./host.js";

const isSame = (one, other) => JSON.stringify(one) === JSON.stringify(other);

function render({ model, el }) {
  const root = hosted(el), page = JSON.parse(model.get("_page")), live = JSON.parse(model.get("_volume"));
  const names = live.densities.map((_, i) => page.components[i].name);
  let later = 0, frame = 0;
  // The traits as the page has them, and the page's texts of them; what is as it opens has an empty text.
  const shared = {
    camera: {
      get(state) { const { azimuth, elevation, zoom, x, y } = seenIn(live, state); return { azimuth, elevation, zoom, pan: [x, y] }; },
      text: ({ azimuth, elevation, zoom, pan }) => ({ seen: [azimuth, elevation, zoom, ...pan].map(digits).join() }),
    },
    crop: {
      get: (state) => inFile(live, cutIn(live, state)),
      text: (corners) => ({ cut: inPage(live, corners).flat().map(digits).join() }),
    },
    densities: {
      get(state) { const all = densitiesIn(live, state); return Object.fromEntries(names.map((name, i) => [name, all[i]])); },
      text: (all) => ({ dense: names.map((name) => digits(all[name] ?? 1)).join() }),
    },
  };
  const opened = Object.fromEntries(Object.entries(shared).map(([name, { get, text }]) => [name, text(get({ seen: "", cut: "", dense: "" }))]));
  // Light and pixel are those of the view in which they were changed last.
  let isTaking = false, isLit = !model.get("_mix")?.length;
  /** Takes a trait over to the page. */
  const take = (name) => {
    const asked = model.get(name), { get, text } = shared[name], texts = text(asked);
    if (isSame(text(get(shown.state)), texts)) return;
    isTaking = true;
    shown.set(isSame(texts, opened[name]) ? Object.fromEntries(Object.keys(texts).map((key) => [key, ""])) : texts);
    isTaking = false;
  };
  /** Gives the page's view to the traits: linked widgets follow at once, Python hears of it at rest. */
  const note = () => {
    frame = 0;
    for (const [name, { get, text }] of Object.entries(shared)) {
      const now = get(shown.state);
      if (!isSame(text(now), text(model.get(name)))) model.set(name, now);
    }
  };
  const save = () => {
    note();
    if (isLit) noteLight(model, shown, page.positions);
    isLit = false;
    model.save_changes();
  };
  const changed = () => {
    isLit ||= !isTaking;
    clearTimeout(later);
    later = setTimeout(save, REST);
    frame ||= requestAnimationFrame(note);
  };
  const shown = mount(root, page, (view) => bytesOf(model.get("_views")[view]), { changed });
  Object.keys(shared).forEach(take);
  takeHand(model, shown);
  save();
  // A cell that is gone needs no more of them.
  const blocks = () => (name) => { if (shown.ended) throw Error("ended"); return inflated(bytesOf(model.get("_blocks")[name]), live.lengths[name]); };
  root.live = open(shown, () => live, blocks, model.get("always"));
  const end = heard(model, {
    ...Object.fromEntries(Object.keys(shared).map((name) => [`change:${name}`, () => take(name)])),
    "change:hand": () => takeHand(model, shown),
  });
  return async () => {
    end();
    cancelAnimationFrame(frame);
    clearTimeout(later);
    shown.end();
    (await root.live)?.end();
  };
}

export default { render };
