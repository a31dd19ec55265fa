#!/usr/bin/env python3
"""Relume beside other renderers on the same work, as a Markdown table.

  benches/peers.py --relume target/release/relume --peers FOLDER --volume frog.mhd > benches/results/lavapipe.md
  benches/peers.py --relume target/release/relume --peers FOLDER --volume frog.mhd --shadows   # for benches/results/shadows.md

FOLDER holds the peer programs (peer_vtk.py, peer_floor.py, peerlib.py); this Python needs what they need, and OpenEXR.
With --before OLD, another build of Relume runs in the same turns, and a second table has its times beside the new ones.
With --shadows, only the frame with one shadowed light runs, beside VTK's GPU mapper with its own shadow, at 400 × 400.
Every program runs in a process of its own, in turn (A B A B …), five times; medians of CPU ms of all threads.
"""
import argparse, json, os, statistics, subprocess, sys, tempfile

arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
arguments.add_argument("--relume", required=True)
arguments.add_argument("--peers", required=True)
arguments.add_argument("--volume", required=True, help="the real frog, 500x470x136")
arguments.add_argument("--before", help="an earlier build of Relume")
arguments.add_argument("--runs", type=int, default=5)
arguments.add_argument("--shadows", action="store_true", help="the frame with one shadowed light, beside VTK's GPU mapper")
given = arguments.parse_args()
relume, volume = os.path.abspath(given.relume), os.path.abspath(given.volume)
environment = dict(os.environ, PEER_VOLUME="frog", FROG_MHD=volume, PEER_SHOTS=tempfile.mkdtemp())


def peer(program, *flags):
    run = subprocess.run([sys.executable, program, *flags], cwd=given.peers, env=environment, capture_output=True, text=True)
    lines = [line for line in run.stdout.splitlines() if line.startswith("JSON ")]
    if not lines:
        sys.exit(f"{program} {' '.join(flags)} printed no result:\n{run.stderr}")
    return json.loads(lines[-1][5:])


def bench(workload, shading, program=relume, *flags):
    command = [program, "bench", workload, "--shading", shading, "--frames", "9", "--json", "--quiet", *flags]
    command += [] if workload == "default" else ["--volume", volume]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)["rows"][0]


def middle(values):
    return statistics.median(values)


def shadows():
    """A table of frames with one shadowed light, shaded: unshaded, the GPU mapper of VTK casts no shadow. The light grid of Relume
    stays while the camera turns."""
    ours, vtk = {False: [], True: []}, {False: [], True: []}
    for run in range(given.runs):
        for shadow in ours:
            lit = f"lights.key.shadows={str(shadow).lower()}"
            ours[shadow].append(bench("peer", "diffuse", relume, "--size", "400x400", "-D", lit))
            flags = ("--mapper", "gpu", "--size", "400", "--shade", "1", "--frames", "3", "--gi", "1" if shadow else "0")
            vtk[shadow].append(peer("peer_vtk.py", *flags))
    device, gpu = ours[True][0]["device"], vtk[True][0]
    print(f"Relume: {device}; VTK {gpu['version']}, GPU mapper: {gpu['device']}. CPU ms of all threads, medians of {given.runs}")
    print("processes each, in turn; real frog averaged to 250 × 235 × 136, 400 × 400, one directional light.\n")
    print("| frame, by gradients | Relume | VTK, GPU mapper | ratio |\n| --- | --- | --- | --- |")
    mine = {shadow: middle([row["march"]["cpu_ms"]["median"] for row in rows]) for shadow, rows in ours.items()}
    theirs = {shadow: middle([row["frame_cpu_ms"] for row in rows]) for shadow, rows in vtk.items()}
    for shadow, what in ((False, "without shadows"), (True, "with one shadowed light")):
        print(f"| {what} | {mine[shadow]:.0f} | {theirs[shadow]:.0f} | {mine[shadow] / theirs[shadow]:.2f} |")
    print(f"| with over without | {mine[True] / mine[False]:.2f} | {theirs[True] / theirs[False]:.2f} | |")


if given.shadows:
    shadows()
    sys.exit()

WORKLOADS = ("peer", "peer-rgb", "peer-k8", "peer-four-lights", "peer-eight-materials", "peer-coloured-rgb", "peer-coloured-k8")
vtk, ours, before = {"none": [], "diffuse": []}, {}, {}
for run in range(given.runs):
    for shading, flag in (("none", "0"), ("diffuse", "1")):
        vtk[shading].append(peer("peer_vtk.py", "--mapper", "fixed", "--size", "800", "--shade", flag))
        for workload in WORKLOADS:
            ours.setdefault((workload, shading), []).append(bench(workload, shading))
            if given.before:
                before.setdefault((workload, shading), []).append(bench(workload, shading, os.path.abspath(given.before)))
    ours.setdefault(("default", "diffuse"), []).append(bench("default", "diffuse"))
    if given.before:
        before.setdefault(("default", "diffuse"), []).append(bench("default", "diffuse", os.path.abspath(given.before)))


def cpu(key, stage="march", of=ours):
    return middle([row[stage]["cpu_ms"]["median"] for row in of[key]])


def psnr(shading, flag):
    import numpy, OpenEXR
    theirs = os.path.join(environment["PEER_SHOTS"], "floor.npy")
    peer("peer_floor.py", "--what", "cast", "--size", "800", "--shade", flag, "--frames", "1", "--out", theirs)
    mine = os.path.join(environment["PEER_SHOTS"], "relume.exr")
    scene = os.path.join(os.path.dirname(__file__), "..", "data", "scenes", "peer.toml")
    changed = [] if shading == "diffuse" else ["-D", "shading=none"]
    subprocess.run([relume, "render", scene, "--volume", volume, "-o", mine, "-q", *changed], check=True, capture_output=True)
    channels = OpenEXR.File(mine).channels()
    picture = channels["RGBA"].pixels if "RGBA" in channels else numpy.stack([channels[c].pixels for c in "RGB"], -1)
    difference = picture[..., :3].astype(float) - numpy.load(theirs)[..., :3]
    return -10 * numpy.log10((difference**2).mean())


device = ours[("peer", "none")][0]
print(f"Device: {device['device']}{' (a software device: these are times of this CPU)' if device['software'] else ''};")
print(f"peer: VTK {vtk['none'][0]['version']} fixed-point mapper. CPU ms of all threads, medians of {given.runs} processes each,")
print("in turn; real frog averaged to 250 × 235 × 136, 800 × 800.\n")
print("| what | Relume | peer | ratio |")
print("|---|---|---|---|")
for shading in ("diffuse", "none"):
    mine, theirs = cpu(("peer", shading)), middle([row["frame_cpu_ms"] for row in vtk[shading]])
    print(f"| march, shading {shading} | {mine:.0f} | {theirs:.0f} | {mine / theirs:.2f} |")
one, four = cpu(("peer", "diffuse")), cpu(("peer-four-lights", "diffuse"))
print(f"| march, shaded, four positions against one | {four:.0f} | {one:.0f} | {four / one:.2f} |")
eight = cpu(("peer-eight-materials", "diffuse"))
print(f"| march, shaded, eight materials against four | {eight:.0f} | {one:.0f} | {eight / one:.2f} |")
for shading in ("diffuse", "none"):
    rgb = cpu(("peer-rgb", shading))
    for what, workload in (("81 bands behind four weights", "peer"), ("k = 8, grey,", "peer-k8")):
        mine = cpu((workload, shading))
        print(f"| march, shading {shading}, {what} against own RGB | {mine:.0f} | {rgb:.0f} | {mine / rgb:.2f} |")
    mine, rgb = cpu(("peer-coloured-k8", shading)), cpu(("peer-coloured-rgb", shading))
    print(f"| march, shading {shading}, k = 8, coloured, against own coloured RGB | {mine:.0f} | {rgb:.0f} | {mine / rgb:.2f} |")
print(f"| relight, one position, 4 weights | {cpu(('peer', 'diffuse'), 'relight'):.2f} | | |")
print(f"| relight, one position, 8 weights | {cpu(('peer-eight-materials', 'diffuse'), 'relight'):.2f} | | |")
print(f"| relight, four positions, 4 weights each | {cpu(('peer-four-lights', 'diffuse'), 'relight'):.2f} | | |")
startup = middle([row["startup_ms"]["median"] for row in ours[("default", "diffuse")]])
print(f"| first picture of the default scene, wall ms | {startup:.0f} | | |")
memory = middle([row["peak_mb"] for row in ours[("peer", "diffuse")]])
print(f"| peak memory, shaded, MB | {memory:.0f} | {middle([row['peak_mb'] for row in vtk['diffuse']]):.0f} | |")
for shading, flag in (("none", "0"), ("diffuse", "1")):
    print(f"| picture against the C ray caster's, shading {shading}, dB | {psnr(shading, flag):.1f} | | |")
if given.before:
    print("\n| what | now | before | ratio |\n|---|---|---|---|")
    for key in before:
        for stage in ("march", "relight"):
            now, then = cpu(key, stage), cpu(key, stage, before)
            print(f"| {stage}, {key[0]}, shading {key[1]} | {now:.2f} | {then:.2f} | {now / then:.3f} |")
