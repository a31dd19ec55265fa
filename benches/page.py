#!/usr/bin/env python3
"""Measures pages of `relume page`, and prints benches/results/page.md.

    benches/page.py [RELUME [FOLDER]]

RELUME is the program (default: target/release/relume). FOLDER has the Whole Frog (frog.mhd, frogtissue.mhd); without it, the
row of its 17 materials is left out. Needs Chromium. Times in the browser are CPU times of the page's process: unpacking a view
from base64, finding runs of pixels and turning groups back (for JavaScript only), and one relight in JavaScript.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SCENES = ROOT / "data/scenes"

PREPARE = """(async () => {
    const text = (id) => document.getElementById(id).textContent, page = JSON.parse(text('relume-page'));
    const script = document.querySelector('script[type=module]').textContent;
    const { fromBase64, unpack, plain, matrices } = await import(URL.createObjectURL(new Blob([script], { type: 'text/javascript' })));
    const letters = text(`relume-view-${page.first}`);
    const canvas = document.createElement('canvas');
    [canvas.width, canvas.height] = page.size;
    const drawer = plain(page, canvas);
    const mix = page.lights.map((light) => ({ position: light.position, weight: light.weight, light }));
    let planes;
    globalThis.acts = {
        unpack: async () => { planes = await unpack(page, page.first, fromBase64(letters)); },
        turn: () => drawer.load(planes),
        relight: (i) => drawer.draw(matrices(page, mix, { observer: '1931', adapt: false, vision: '', exposure: 1 + i / 24 })),
    };
    globalThis.times = async (act, count) => { for (let i = 0; i < count; i++) await acts[act](i); };
    return 0;
})()"""


class Chromium:
    """Chromium, driven over its remote debugging pipe."""

    def __init__(self, folder):
        options = ["--headless", "--no-sandbox", "--no-first-run", "--remote-debugging-pipe", f"--user-data-dir={folder}"]
        command = ["sh", "-c", 'exec chromium "$@" 3<&0 4>&1', "chromium", *options, "about:blank"]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        self.number = 0

    def send(self, method, parameters, session=None):
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters, **({"sessionId": session} if session else {})}
        self.process.stdin.write(json.dumps(message).encode() + b"\0")
        self.process.stdin.flush()
        while True:
            text = b""
            while not text.endswith(b"\0"):
                text += self.process.stdout.read1(1) or sys.exit("page.py: Chromium ended")
            answer = json.loads(text[:-1])
            if answer.get("id") == self.number:
                return answer["result"]

    def times(self, page):
        target = self.send("Target.createTarget", {"url": "about:blank"})["targetId"]
        session = self.send("Target.attachToTarget", {"targetId": target, "flatten": True})["sessionId"]
        self.send("Page.enable", {}, session)
        self.send("Page.setBypassCSP", {"enabled": True}, session)
        self.send("Page.navigate", {"url": f"{page.as_uri()}#draw=cpu"}, session)
        value = lambda expression: self.send("Runtime.evaluate", {"expression": expression, "awaitPromise": True, "returnByValue": True}, session)["result"]["value"]
        value("(async () => { while (!document.getElementById('relume')?.dataset.ready) await new Promise((go) => setTimeout(go, 50)); return 0; })()")
        value(PREPARE)
        renderers = lambda: sum(one["cpuTime"] for one in self.send("SystemInfo.getProcessInfo", {})["processInfo"] if one["type"] == "renderer")
        spent = []
        for act, count in (("unpack", 8), ("turn", 6), ("relight", 24)):
            # The first runs compile.
            value(f"times('{act}', 2).then(() => 0)")
            before = renderers()
            value(f"times('{act}', {count}).then(() => 0)")
            spent.append(1e3 * (renderers() - before) / count)
        self.send("Target.closeTarget", {"targetId": target})
        return spent


def main():
    relume = sys.argv[1] if len(sys.argv) > 1 else str(ROOT / "target/release/relume")
    frog = Path(sys.argv[2]) if len(sys.argv) > 2 else None
    cases = [
        ("built-in scene, 6 materials", []),
        ("stained frog, k = 8", [str(SCENES / "stained_frog.toml"), "--k", "8"]),
        ("engine", [str(SCENES / "engine.toml")]),
        ("figure 6, designed lights", [str(ROOT / "data/figures/fig6.toml")]),
        ("built-in scene, 24 views of 400×400", ["--views", "24", "--size", "400x400"]),
    ]
    if frog:
        labelled = [str(SCENES / "frog.toml"), "--volume", str(frog / "frog.mhd"), "--labels", str(frog / "frogtissue.mhd")]
        cases.insert(1, ("labelled frog, 17 materials", labelled))
    print("# Pages\n")
    print("`benches/page.py` prints this page. 800×800 pixels and tolerance 0.5, unless stated. Times are CPU\ntimes of all cores, on a shared two-core machine.\n")
    print("| film | channels | page, MB | packed, MB | largest ΔE00 | rendering, CPU ms | packing, CPU ms | unpacking, ms | runs and turning back, ms | relight in JavaScript, ms |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        browser = Chromium(Path(folder, "profile"))
        for name, arguments in cases:
            page = Path(folder, "page.html")
            command = [relume, "page", *arguments, "-o", str(page), "--json"]
            told = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL).stdout)
            kept, spent = told["page"], told["times"]["pack"]["cpu_ms"]
            rendering = sum(told["times"][stage]["cpu_ms"] for stage in ("load", "march"))
            unpacking, turning, relight = browser.times(page)
            numbers = [kept["channels"], f"{kept['bytes'] / 1e6:.2f}", f"{kept['packed_bytes'] / 1e6:.2f}", f"{kept['largest_error']:.2f}"]
            numbers += [f"{rendering:.0f}", f"{spent:.0f}", f"{unpacking:.0f}", f"{turning:.0f}", f"{relight:.0f}"]
            print(f"| {name} | {' | '.join(map(str, numbers))} |", flush=True)
        browser.process.terminate()
    script = os.path.getsize(ROOT / "src/document/output/page/relume.min.js")
    print(f"\nThe script has {script} bytes, the style {os.path.getsize(ROOT / 'src/document/output/page/style.css')}.")


main()
