#!/usr/bin/env python3
"""Time to an error of light that scatters any number of times: Relume's rows of transfer factors beside the path tracer of
Mitsuba 3, as a Markdown table.

  benches/scattering.py --relume target/release/relume --frog frog.mhd > benches/results/scattering.md

This Python needs mitsuba and numpy, and the machine two cores. Pictures are orthographic, 48 x 48 pixels, with one directional light
and grey materials:

  box   a constant medium, two free paths along each edge, whose face fills the picture
  frog  voxels averaged to 62 x 58 x 34, transfer function of data/scenes/peer.toml, unshaded, as deep by voxels as the frog itself; a
        pixel is the mean of 64 rays, as those of Mitsuba are means over their area

Errors are the rms of the difference over the mean, of pixels that show the volume. The truth for both is Mitsuba's picture, in two
independent halves A and B of N samples a pixel each. The mean of (R - A)(R - B) is the squared error of Relume's picture R without the
noise of the halves; "at most" adds two standard errors of that mean. So differences of the models count as errors of Relume. Mitsuba's
error at N is the rms of A - B over the root of 2. It falls with the root of the samples, as N/8 shows, so Mitsuba's time to the target
is that of N times the square of its error over the target.

A light of mean intensity 1 in Relume is an irradiance of 4 pi in Mitsuba, so luminances are compared as they are. Mitsuba's grid of the
frog has the extinction of four times as many places along each axis. There the voxels are interpolated, then classified, as
Relume does at each sample.

Times are CPU s of one thread. Relume: the whole command `relume render` (light grid, rows, solution, march, file), the median of several, less
start-up: the same command for one pixel, without shadows and deeper orders (device, shaders, volume, plan). In brackets, start-up counts.
Mitsuba: rendering alone, without imports and the making of its scene.
"""
import argparse, os, pathlib, resource, statistics, subprocess, sys, tempfile, tomllib

import drjit, mitsuba, numpy

SIDE = 48
BOX = """version = 1
shading = "none"
volume = { file = "box.raw", dims = [17, 17, 17], type = "uint8", spacing = [0.125, 0.125, 0.125], origin = [-1, -1, -1] }
materials.grey.reflectance = 0.9
[transfer]
opacity_length = 1
intervals = [{ material = "grey", range = [0, 255], opacity = 0.6321205588285577 }]  # 1 - 1/e
[lights.key]
spectrum = 1
kind = "directional"
direction = [0.6, 0, -0.8]
[camera]
projection = "orthographic"
height = 2
position = [0, 0, -10]
target = [0, 0, 0]
up = [0, 1, 0]
[accuracy]
step = 0.0625
termination = 0
"""
EYE, TARGET, HEIGHT = [66.1, -9.0, -61.5], [30.5, 28.5, 16.5], 66.0  # of the frog, in voxels
PEER = pathlib.Path(__file__).parent.parent / "data" / "scenes" / "peer.toml"

arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
arguments.add_argument("--relume", required=True)
arguments.add_argument("--frog", required=True, help="the real frog, 500x470x136")
arguments.add_argument("--runs", type=int, default=5, help="of Relume")
arguments.add_argument("--samples", type=int, default=3000, help="N of the box, a multiple of 3000; the frog has twice as many")
arguments.add_argument("--variant", default="scalar_rgb", help="of Mitsuba; llvm_ad_mono needs LLVM 16 or later")
given = arguments.parse_args()
mitsuba.set_variant(given.variant)
# One worker, and the thread that waits for it. With none, scalar variants wait for ever.
drjit.set_thread_count(2)
relume, folder = os.path.abspath(given.relume), tempfile.TemporaryDirectory()
single = dict(os.environ, LP_NUM_THREADS="1", RAYON_NUM_THREADS="1")
place = lambda name: os.path.join(folder.name, name)


def cpu(of):
    used = resource.getrusage(of)
    return used.ru_utime + used.ru_stime


def run(*command):
    """CPU s of Relume on one core."""
    before = cpu(resource.RUSAGE_CHILDREN)
    done = subprocess.run([relume, *command, "-q"], env=single, capture_output=True, text=True,
                          preexec_fn=lambda: os.sched_setaffinity(0, {0}))
    if done.returncode:
        sys.exit(done.stderr)
    return cpu(resource.RUSAGE_CHILDREN) - before


def picture(scene, **scattering):
    """Luminance and opacity of Relume's picture, CPU s of the command, and those of start-up."""
    command = ["render", *scene, "-o", place("relume.exr"), "-D", "shadows={start=0,spacing=1}", "--size"]
    many = ["-D", 'scattering.orders="multiple"'] + [part for key, value in scattering.items() for part in ("-D", f"scattering.{key}={value}")]
    first = command + ["1x1", "-D", "lights.key.shadows=false"]
    run(*first), run(*command, f"{SIDE}x{SIDE}", *many)  # compiles shaders, which the driver keeps
    start = statistics.median(run(*first) for _ in range(given.runs))
    whole = statistics.median(run(*command, f"{SIDE}x{SIDE}", *many) for _ in range(given.runs))
    pixels = numpy.array(mitsuba.Bitmap(place("relume.exr"))).astype(float)
    return pixels[..., :3] @ [0.2126, 0.7152, 0.0722], pixels[..., 3], whole, start


def traced(camera, height, towards, medium, to_world):
    """A function from samples and a seed to Mitsuba's picture and its CPU s."""
    film = {"type": "hdrfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "box"}, "component_format": "float32", "pixel_format": "luminance"}
    scene = mitsuba.load_dict({
        "type": "scene",
        "integrator": {"type": "volpath", "max_depth": -1, "rr_depth": 12},
        "sensor": {"type": "orthographic", "to_world": camera.scale([height / 2, height / 2, 1]), "film": film},
        "light": {"type": "directional", "direction": [-part for part in towards], "irradiance": 4 * numpy.pi},
        "volume": {"type": "cube", "to_world": to_world, "bsdf": {"type": "null"}, "interior": medium},
    })
    render = lambda samples, seed: numpy.array(mitsuba.render(scene, spp=samples, seed=seed))[..., 0].astype(float)
    render(1, 0)  # what the first picture alone needs

    def timed(samples, seed, part=375):
        before = cpu(resource.RUSAGE_SELF)
        # In parts, as vector variants hold all samples at once. No two parts have the same seed.
        pixels = sum(render(part, 1000 * seed + number) for number in range(samples // part)) / (samples // part)
        return pixels, cpu(resource.RUSAGE_SELF) - before

    return timed


def halves(of, samples, seed):
    """Two independent pictures, and the CPU s of one."""
    (one, first), (other, second) = of(samples, seed), of(samples, seed + 1)
    return one, other, (first + second) / 2


def row(name, albedo, setting, target, of_relume, truth, few):
    pixels, opacity, whole, start = of_relume
    seen = opacity > 0.01
    mean = ((truth[0] + truth[1]) / 2)[seen].mean()
    noise = lambda pair: 100 * numpy.sqrt(((pair[0] - pair[1])[seen] ** 2).mean() / 2) / mean
    squares = (((pixels - truth[0]) * (pixels - truth[1]))[seen]) / mean**2
    square, doubt = squares.mean(), squares.std() / seen.sum() ** 0.5
    error, most = (100 * max(part, 0) ** 0.5 for part in (square, square + 2 * doubt))
    mine, theirs = whole - start, truth[2] * (noise(truth) / target) ** 2
    shift = 100 * (pixels[seen].mean() / mean - 1)
    print(f"| {name} | {albedo} | {setting} | {target} | {error:.2f} (at most {most:.2f}) | {shift:+.2f} | {mine:.2f} ({whole:.2f})",
          f"{noise(few):.1f}, {few[2]:.2f} s | {noise(truth):.2f}, {truth[2]:.1f} s | {theirs:.1f} | {theirs / mine:.0f} ({theirs / whole:.0f}) |",
          sep=" | ", flush=True)


def frog():
    """Arguments of Relume, and Mitsuba's camera, medium and place of it."""
    run("convert", given.frog, place("frog.mha"), "--downsample", "8x8x4")
    content = pathlib.Path(place("frog.mha")).read_bytes()
    header = dict(line.split(" = ") for line in content.split(b"LOCAL")[0].decode().splitlines() if " = " in line)
    dims = [int(number) for number in header["DimSize"].split()]
    values = numpy.frombuffer(content[-int(numpy.prod(dims)):], numpy.uint8).reshape(dims[::-1]).astype(numpy.float32)
    for axis, count in enumerate(values.shape):
        at = numpy.arange(4 * count - 3) / 4
        low = numpy.minimum(at.astype(int), count - 2)
        part = (at - low).astype(numpy.float32).reshape([-1 if it == axis else 1 for it in range(3)])
        values = values.take(low, axis) * (1 - part) + values.take(low + 1, axis) * part
    # The table of the scene has an entry a grey value, of which the nearest counts.
    opacity = numpy.interp(numpy.rint(values), *zip(*tomllib.loads(PEER.read_text())["transfer"]["opacity"]))
    extinction = -numpy.log1p(-opacity)[..., None].astype(numpy.float32)
    transform = mitsuba.ScalarTransform4f
    # Mitsuba has the middles of texels half a texel inside its cube, and Relume those of voxels on the faces of its box.
    grid = {"type": "gridvolume", "grid": mitsuba.VolumeGrid(extinction), "raw": True, "wrap_mode": "clamp",
            "to_world": transform().translate([-0.125] * 3).scale([(4 * count - 3) / 4 for count in dims])}
    changes = ["volume.downsample=[1,1,1]", "volume.origin=[0,0,0]", "shading=none", "materials.*.reflectance=0.9", "lights.key.spectrum=1",
               "accuracy.step=0.5", "accuracy.rays=64",
               f"camera={{projection=\"orthographic\",height={HEIGHT},position={EYE},target={TARGET},up=[0,-1,0]}}"]
    scene = [str(PEER), "--volume", place("frog.mha"), *(part for change in changes for part in ("-D", change))]
    return (scene, transform().look_at(origin=EYE, target=TARGET, up=[0, -1, 0]), {"type": "heterogeneous", "albedo": 0.9, "sigma_t": grid},
            transform().scale([(count - 1) / 2 for count in dims]).translate([1, 1, 1]))


version = subprocess.run([relume, "--version"], capture_output=True, text=True).stdout.strip()
print(f"`benches/scattering.py --relume target/release/relume --frog frog.mhd --variant {given.variant}`: {version}; Mitsuba")
print(f"{mitsuba.__version__}, `volpath`. CPU s of one thread; errors and targets in %. N is {given.samples} samples a pixel of the box, {2 * given.samples} of the frog.\n")
print("| scene | albedo | nodes of Relume | target | rms of Relume | mean | CPU s | rms of Mitsuba at N/8, CPU s | at N | s to the target | ratio |")
print("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |")
transform = mitsuba.ScalarTransform4f
pathlib.Path(place("box.raw")).write_bytes(bytes([100]) * 17**3)
pathlib.Path(place("box.toml")).write_text(BOX)
for albedo in (0.5, 0.9, 0.99):
    camera = transform().look_at(origin=[0, 0, -10], target=[0, 0, 0], up=[0, 1, 0])
    box = traced(camera, 2, [0.6, 0, -0.8], {"type": "homogeneous", "albedo": albedo, "sigma_t": 1.0}, transform())
    truth, few = halves(box, given.samples, 1), halves(box, given.samples // 8, 3)
    for spacing, cells in ((2, "1/4"), (1.6, "1/5")):  # voxels are 1/8 of a free path
        found = picture([place("box.toml"), "-D", f"materials.grey.reflectance={albedo}"], spacing=spacing, directions=32)
        row("box", albedo, f"{cells} of a free path, 32 directions", 1, found, truth, few)
scene, camera, medium, to_world = frog()
paths = traced(camera, HEIGHT, [-0.4, -0.7, -0.6], medium, to_world)
truth, few = halves(paths, 2 * given.samples, 1), halves(paths, given.samples // 4, 3)
for spacing, name in ((1, "1 voxel"), (2, "2 voxels")):
    row("frog", 0.9, f"{name}, 8 directions", 2, picture(scene, spacing=spacing, directions=8), truth, few)
