#!/usr/bin/env python3
"""Time against error of point samples, segments and adaptive samples along rays, as a Markdown table: one row a scene.

  benches/segments.py --relume target/release/relume --volumes FOLDER

FOLDER has frog.mhd, frogtissue.mhd, engine.vti and the CT head quarter.nhdr, anywhere below it. `relume measure` makes all
numbers: CPU ms of all threads of the march, the fastest run, at 800 x 800 pixels, and the 95th percentile of Delta E 2000 of
pixels that show something, against the truth of `measure`. Samples have the steps 1, 0.5 and 0.25; segments the steps 1, 1.5 and
2, adaptive samples the steps 1, 1.25, 1.5 and 2, and both several variations.

  same error   the fastest segments that have at most the error of samples with a step of 0.25, over their time
  adaptive     adaptive samples with the step 1 and the default variation
  1.25 ×       the smallest error of any setting that takes at most 1.25 times the time of samples with a step of 1, over the error of
               these, and what it is
  1.5 ×        the same of 1.5 times the time
"""
import argparse, json, pathlib, subprocess, sys, tempfile

SAMPLES = ["integration=samples,step=1,0.5,0.25"]
SEGMENTS = ["integration=segments,step=1,1.5,2,variation=0.0001,0.0003,0.001,0.003,0.01,0.03,1"]
ADAPTIVE = ["integration=adaptive,step=1,1.25,1.5,2,variation=0.0003,0.001,0.003,0.01,0.03"]
USUAL = 0.001  # the default

# Skin and bone of a CT head (Hounsfield units + 1024) in narrow intervals.
HEAD = """version = 1
[materials.skin]
reflectance = "light skin"
[materials.bone]
reflectance = { 380 = 0.38, 430 = 0.60, 500 = 0.74, 600 = 0.80, 780 = 0.84 }
[transfer]
intervals = [
    { material = "skin", range = [500, 540], ramp = 20, opacity = 0.1 },
    { material = "bone", range = [1150, 1190], ramp = 20, opacity = 0.4 },
]
[lights.day]
spectrum = "D65"
kind = "directional"
direction = [-0.5, 0.8, -0.6]
[camera]
azimuth = 20
elevation = 10
"""

# Intervals 3 and 4 grey values wide.
NARROW = ["-D", 'transfer.intervals.organs.range=[24, 28]', "-D", "transfer.intervals.organs.ramp=1",
          "-D", 'transfer.intervals.muscle.range=[80, 83]', "-D", "transfer.intervals.muscle.ramp=1",
          "-D", 'transfer.intervals.bone.range=[126, 130]', "-D", "transfer.intervals.bone.ramp=1",
          "-D", 'transfer.intervals.eye_white.range=[140, 144]', "-D", "transfer.intervals.eye_white.ramp=1"]


def scenes(volumes, folder):
    """Pairs of a name and the arguments of `relume measure`."""
    def find(name):
        found = next(pathlib.Path(volumes).rglob(name), None)
        return str(found) if found else sys.exit(f"{volumes} has no {name}")

    scene = lambda name: str(pathlib.Path(__file__).parent.parent / "data" / "scenes" / name)
    head = pathlib.Path(folder) / "head.toml"
    head.write_text(HEAD)
    frog, tissues = find("frog.mhd"), find("frogtissue.mhd")
    return [
        ("default scene", [scene("default.toml")]),
        ("frog", [scene("frog.toml"), "--volume", frog]),
        ("frog with labels", [scene("frog.toml"), "--volume", frog, "--labels", tissues]),
        ("engine", [scene("engine_ct.toml"), "--volume", find("engine.vti")]),
        ("CT head, narrow skin and bone", [str(head), "--volume", find("quarter.nhdr")]),
        ("stained frog", [scene("stained_frog.toml")]),
        ("frog, narrow intervals", [scene("frog.toml"), "--volume", frog, *NARROW]),
    ]


def points(relume, scene, sweeps, given):
    """Rows of a sweep: (error, CPU ms, setting)."""
    command = [relume, "measure", *scene, "--quiet", "--json", "--size", given.size, "--runs", str(given.runs), "--pixels", str(given.pixels)]
    for sweep in sweeps:
        command += ["--sweep", sweep]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stderr.strip() or f"relume: exit code {done.returncode}")
    return [(row["error"]["p95"], row["times"]["march"]["cpu_ms"]["min"], row["setting"]) for row in json.loads(done.stdout)["rows"]]


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--relume", required=True)
    arguments.add_argument("--volumes", required=True)
    arguments.add_argument("--size", default="800x800")
    arguments.add_argument("--runs", type=int, default=3)
    arguments.add_argument("--pixels", type=int, default=4096)
    arguments.add_argument("--only", help="part of the name of a scene")
    given = arguments.parse_args()
    print("| scene | samples, step 1 | 0.5 | 0.25 | segments of that error | same error | adaptive | 1.25 × | 1.5 × |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        for name, scene in scenes(given.volumes, folder):
            if not given.only or given.only in name:
                row(name, points(given.relume, scene, SAMPLES + SEGMENTS + ADAPTIVE, given))


def row(name, found):
    of = lambda kind: [point for point in found if point[2].get("integration") == kind]
    samples = {point[2]["step"]: point for point in of("samples")}
    say = lambda point: f"{point[1]:.0f} : {point[0]:.2f}"
    setting = lambda point: f"{point[2]['integration']}, step {point[2]['step']:g}" + (
        f", variation {point[2]['variation']:g}" if point[2]["integration"] != "samples" else "")
    finest, first = samples[0.25], samples[1]
    good = [point for point in of("segments") if point[0] <= finest[0]]
    fastest = min(good, key=lambda point: point[1], default=None)
    least = min(of("segments"), key=lambda point: point[0])
    same_error = f"{say(fastest)} ({setting(fastest)}) | {fastest[1] / finest[1]:.2f}" if fastest else f"none: at least {say(least)} | "
    usual = next(point for point in of("adaptive") if (point[2]["step"], point[2]["variation"]) == (1, USUAL))

    def best(times):
        quick = [point for point in found if "integration" in point[2] and point[1] <= times * first[1]]
        one = min(quick, key=lambda point: point[0])
        return f"{one[0] / first[0]:.2f} ({setting(one)})"

    print(f"| {name} | {say(first)} | {say(samples[0.5])} | {say(finest)} | {same_error} | {say(usual)} | {best(1.25)} | {best(1.5)} |", flush=True)


main()
