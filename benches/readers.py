#!/usr/bin/env python3
"""Reading volumes with Relume beside the usual libraries of Python, as a Markdown table; memory while reading; a folder.

  benches/readers.py --relume target/release/relume > benches/results/readers.md
  benches/readers.py --relume target/release/relume --large           # uncompressed files of 201 MB alone
  benches/readers.py --relume target/release/relume --memory          # memory alone
  benches/readers.py --relume target/release/relume --folder          # a folder of 2,000 slices alone

Needs numpy, nibabel, SimpleITK, pydicom (with pylibjpeg, pylibjpeg-openjpeg, pylibjpeg-libjpeg, pyjpegls), tifffile,
imagecodecs, zarr and h5py. The volumes are made by these libraries: 256 x 256 x 128 voxels of 16 bits, smooth with noise.
Each reading is a process of its own, in turn (A B A B ...); CPU ms (user and system) of all threads, of the fastest of five
readings after one to warm up, and the median of the processes. The start of a process counts on neither side. Wall time is
what both cores take together.

The larger volumes have 512 x 512 x 384 voxels. Memory for up to 32 MB comes from blocks that the readings before have freed:
Relume clears them, and NumPy does not. The memory of larger volumes is new for each reading, as that of the first one is.

Memory is the peak resident set of `relume bench load`, which opens the volume, minus the voxels: the bar is 64 MB and one
frame or chunk a thread. The program itself is in it. These volumes are larger, so that a copy would not go unnoticed.

The folder has 2,000 slices of 512 x 512 pixels of 16 bits: `relume info` reads all of it for the statistics; `first news` is
the time after which a program that opens the folder shows a progress bar.
"""
import argparse, json, os, platform, resource, shutil, statistics, subprocess, sys, tempfile, time

DIMS = (128, 256, 256)
LARGE = (384, 512, 512)
SLICES = (2000, 512, 512)

READ = {
    "nibabel": "import nibabel\ndef read(path): return numpy.array(nibabel.load(path).dataobj)",
    "SimpleITK": "import SimpleITK\ndef read(path):\n    global image\n    image = SimpleITK.ReadImage(path)\n"
    "    return SimpleITK.GetArrayViewFromImage(image)",
    "SimpleITK series": "import SimpleITK\ndef read(path):\n    global image\n    image = SimpleITK.ReadImage("
    "SimpleITK.ImageSeriesReader.GetGDCMSeriesFileNames(path))\n    return SimpleITK.GetArrayViewFromImage(image)",
    "pydicom": "import glob, pydicom\ndef read(path):\n    slices = [pydicom.dcmread(p) for p in glob.glob(path + '/*')]\n"
    "    slices.sort(key=lambda s: float(s.ImagePositionPatient[2]))\n    return numpy.stack([s.pixel_array for s in slices])",
    "tifffile": "import tifffile\ndef read(path): return tifffile.imread(path)",
    "zarr": "import zarr\ndef read(path): return zarr.open(path, mode='r')[...]",
    "h5py": "import h5py\ndef read(path): return h5py.File(path, 'r')['volume'][...]",
    "numpy": "def read(path): return numpy.load(path)",
}

PEER = """
import json, sys, time, warnings
warnings.simplefilter('ignore')
import numpy
{read}
path, cpu, wall = sys.argv[1], [], []
for turn in range(6):
    start = time.process_time(), time.perf_counter()
    volume = read(path)
    cpu.append(1000 * (time.process_time() - start[0]))
    wall.append(1000 * (time.perf_counter() - start[1]))
print(json.dumps(dict(cpu_ms=min(cpu[1:]), wall_ms=min(wall[1:]), sum=int(numpy.asarray(volume).sum(dtype='int64')))))
"""


def volume(dims):
    import numpy
    y, x = numpy.indices(dims[1:])
    noise = numpy.random.default_rng(1)
    data = numpy.empty(dims, "uint16")
    for z in range(dims[0]):
        smooth = 900 + 600 * numpy.sin(x / 19) * numpy.cos(y / 23) * numpy.sin(z / 17)
        data[z] = smooth + noise.integers(0, 30, dims[1:])
    return data


def make(folder, dims):
    """Writes the files; returns (what, path, names of peers)."""
    import h5py, nibabel, numpy, tifffile, zarr
    data, made = volume(dims), []

    def add(what, name, *peers):
        made.append((what, os.path.join(folder, name), peers))
        return made[-1][1]

    turned = numpy.ascontiguousarray(data.transpose(2, 1, 0))
    for what, name in [("NIfTI", "v.nii"), ("NIfTI, gzip", "g.nii.gz")]:
        nibabel.save(nibabel.Nifti1Image(turned, numpy.eye(4)), add(what, name, "nibabel", "SimpleITK"))
    numpy.save(add("NumPy", "v.npy", "numpy"), data)
    for compression in [None, "lzw", "deflate"]:
        path = add(f"TIFF, {compression or 'uncompressed'}", f"{compression}.tif", "tifffile", "SimpleITK")
        tifffile.imwrite(path, data, compression=compression, predictor=compression is not None, rowsperstrip=32)
    from zarr.codecs import BloscCodec, GzipCodec, ZstdCodec
    for codec in [None, BloscCodec(cname="lz4"), ZstdCodec(), GzipCodec()]:
        name = type(codec).__name__.removesuffix("Codec").lower() if codec else "uncompressed"
        path = add(f"Zarr 3, {name}", f"{name}.zarr", "zarr")
        array = zarr.create_array(path, shape=dims, chunks=(64, 64, 64), dtype="uint16", compressors=[codec] if codec else None)
        array[...] = data
    for compression in ["gzip", "lzf"]:
        path = add(f"HDF5, {compression}, shuffle", f"{compression}.h5", "h5py")
        with h5py.File(path, "w") as file:
            file.create_dataset("volume", data=data, chunks=(64, 64, 64), compression=compression, shuffle=True)
    dicom(folder, data, add)
    if dims == LARGE:
        further(folder, data, add)
    return made


def further(folder, data, add):
    """Writes files whose reading may take more memory than others: other orders, halves, streams of many frames."""
    import h5py, numpy, pydicom, tifffile, zarr
    from pydicom.uid import DeflatedExplicitVRLittleEndian
    numpy.save(add("NumPy, Fortran order", "fortran.npy"), numpy.asfortranarray(data))
    halves = (data / 16).astype("float16")
    numpy.save(add("NumPy, float16", "half.npy"), halves)
    tifffile.imwrite(add("TIFF, float16", "half.tif"), halves)
    array = zarr.create_array(add("Zarr 3, float16", "half.zarr"), shape=data.shape, chunks=(64, 64, 64), dtype="float16")
    array[...] = halves
    with h5py.File(add("HDF5, float16", "half.h5"), "w") as file:
        file.create_dataset("volume", data=halves, chunks=(64, 64, 64))
    with h5py.File(add("HDF5, contiguous", "plain.h5"), "w") as file:
        file.create_dataset("volume", data=data)
    one = pydicom.dcmread(os.path.join(folder, "uncompressed", "0000.dcm"))
    one.NumberOfFrames, one.PixelData = len(data), data.tobytes()
    del one.ImagePositionPatient, one.ImageOrientationPatient
    one.GridFrameOffsetVector = [float(z) for z in range(len(data))]
    one.ImagePositionPatient, one.ImageOrientationPatient = [0, 0, 0], [1, 0, 0, 0, 1, 0]
    one.file_meta.TransferSyntaxUID = DeflatedExplicitVRLittleEndian
    one.save_as(add("DICOM, deflated, many frames", "deflated.dcm"))


def dicom(folder, data, add):
    import imagecodecs
    from pydicom.uid import ExplicitVRLittleEndian, JPEG2000Lossless, JPEGLosslessSV1, JPEGLSLossless, RLELossless

    codings = {
        "uncompressed": (ExplicitVRLittleEndian, None),
        "RLE": (RLELossless, None),
        "JPEG lossless": (JPEGLosslessSV1, lambda image: imagecodecs.ljpeg_encode(image, bitspersample=16)),
        "JPEG-LS": (JPEGLSLossless, imagecodecs.jpegls_encode),
        "JPEG 2000": (JPEG2000Lossless, lambda image: imagecodecs.jpeg2k_encode(image, codecformat="j2k", level=0, reversible=True)),
    }
    for what, (syntax, encode) in codings.items():
        series(add(f"DICOM, {what}", what.replace(" ", "_"), "pydicom", "SimpleITK series"), data, syntax, encode)


def series(path, data, syntax, encode):
    import pydicom
    from pydicom.encaps import encapsulate
    from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, RLELossless, generate_uid

    os.makedirs(path)
    series, study, frame = generate_uid(), generate_uid(), generate_uid()
    for z, image in enumerate(data):
        meta = pydicom.dataset.FileMetaDataset()
        meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID = CTImageStorage, generate_uid()
        meta.TransferSyntaxUID = ExplicitVRLittleEndian if syntax == RLELossless else syntax
        slice = pydicom.dataset.FileDataset(None, {}, file_meta=meta, preamble=b"\0" * 128)
        slice.SOPClassUID, slice.SOPInstanceUID = CTImageStorage, meta.MediaStorageSOPInstanceUID
        slice.SeriesInstanceUID, slice.StudyInstanceUID, slice.FrameOfReferenceUID = series, study, frame
        slice.Modality, slice.SeriesNumber, slice.InstanceNumber = "CT", 1, z + 1
        slice.ImagePositionPatient, slice.ImageOrientationPatient = [0, 0, float(z)], [1, 0, 0, 0, 1, 0]
        slice.PixelSpacing, slice.SliceThickness = [1, 1], 1
        slice.Rows, slice.Columns = image.shape
        slice.SamplesPerPixel, slice.PhotometricInterpretation = 1, "MONOCHROME2"
        slice.BitsAllocated, slice.BitsStored, slice.HighBit, slice.PixelRepresentation = 16, 16, 15, 0
        slice.PixelData = encapsulate([encode(image)]) if encode else image.tobytes()
        slice["PixelData"].VR = "OB" if encode else "OW"
        if syntax == RLELossless:
            slice.compress(syntax)
        slice.save_as(os.path.join(path, f"{z:04}.dcm"), enforce_file_format=True)


def run(command):
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        return (done.stderr.strip() or f"exit code {done.returncode}").splitlines()[-1][:90]
    return json.loads(done.stdout)


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--relume", required=True)
    arguments.add_argument("--build", default="release", help="profile of the build, for the head of the table")
    arguments.add_argument("--runs", type=int, default=3)
    arguments.add_argument("--large", action="store_true", help="only larger volumes, uncompressed")
    arguments.add_argument("--memory", action="store_true", help="only memory while reading")
    arguments.add_argument("--folder", action="store_true", help="only a folder of 2,000 slices")
    given = arguments.parse_args()
    relume = os.path.abspath(given.relume)
    everything = not (given.large or given.memory or given.folder)
    if everything:
        with tempfile.TemporaryDirectory() as folder:
            table(make(folder, DIMS), DIMS, relume, given)
            versions()
    if given.large or given.memory or everything:
        with tempfile.TemporaryDirectory() as folder:
            made = make(folder, LARGE)
            if not given.memory:
                print()
                plain = {"NIfTI", "NumPy", "TIFF, uncompressed", "Zarr 3, uncompressed", "DICOM, uncompressed"}
                table([one for one in made if one[0] in plain], LARGE, relume, given)
            if not given.large:
                memory(made, relume)
    if given.folder or everything:
        with tempfile.TemporaryDirectory() as folder:
            of_folder(folder, relume, given.runs)


def memory(made, relume):
    print(f"\nMemory while reading {' x '.join(map(str, reversed(LARGE)))} voxels, in MB of 10^6 bytes.\n")
    print("| file | voxels | peak resident | beyond the voxels |")
    print("| --- | --- | --- | --- |")
    for what, path, _ in made:
        row = run([relume, "bench", "load", "--volume", path, "--frames", "1", "--json", "--quiet"])
        if isinstance(row, str):
            sys.exit(f"{path}: {row}")
        voxels, peak = row["load"]["voxels_mb"], row["load"]["peak_mb"]
        print(f"| {what} | {voxels:.1f} | {peak:.1f} | {peak - voxels:.1f} |", flush=True)


def of_folder(folder, relume, runs):
    from pydicom.uid import ExplicitVRLittleEndian
    path = os.path.join(folder, "scan")
    series(path, volume(SLICES), ExplicitVRLittleEndian, None)
    walls, cpus, news = [], [], []
    for _ in range(runs + 1):
        before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run([relume, "info", path, "--quiet"], check=True, stdout=subprocess.DEVNULL)
        walls.append(time.perf_counter() - start)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        cpus.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    # The bar of the terminal and that of the window have the same news; a terminal is needed to see the first.
    for _ in range(runs):
        news.append(first_news([relume, "info", path]))
    print(f"\nA folder of {SLICES[0]:,} DICOM slices of {SLICES[1]} x {SLICES[2]} pixels ({SLICES[0] * SLICES[1] * SLICES[2] * 2 / 1e9:.2f} GB), "
          f"in s, the fastest of {runs} after one to warm up.\n")
    print("| | wall | CPU |")
    print("| --- | --- | --- |")
    print(f"| `relume info` | {min(walls[1:]):.2f} | {min(cpus[1:]):.2f} |")
    print(f"| first news of the progress | {min(news):.2f} | |")


def first_news(command):
    """Seconds until the progress bar of a command appears on its terminal."""
    import pty, select
    parent, child = pty.openpty()
    start = time.perf_counter()
    process = subprocess.Popen(command, stdin=child, stdout=subprocess.DEVNULL, stderr=child)
    os.close(child)
    seen, text = None, b""
    while process.poll() is None:
        if select.select([parent], [], [], 0.01)[0]:
            try:
                text += os.read(parent, 4096)
            except OSError:
                break
            if seen is None and (b"listing" in text or b"reading" in text):
                seen = time.perf_counter() - start
    process.wait()
    os.close(parent)
    return seen if seen is not None else float("nan")


def table(made, dims, relume, given):
    cpu = next((line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), platform.machine())
    print(f"{' x '.join(map(str, reversed(dims)))} voxels of 16 bits; {cpu}, {os.cpu_count()} cores; {given.build} build of Relume.")
    print("CPU ms of all threads, and wall ms in brackets; the ratios are to the fastest peer. Load of the machine at the beginning: "
          f"{os.getloadavg()[0]:.1f}.\n")
    print("| file | Relume | peers | CPU ratio | wall ratio |")
    print("| --- | --- | --- | --- | --- |")
    for what, path, peers in made:
        ours, walls, theirs = [], [], {name: [] for name in peers}
        for _ in range(given.runs):
            row = run([relume, "bench", "load", "--volume", path, "--frames", "5", "--json", "--quiet"])
            if isinstance(row, str):
                sys.exit(f"{path}: {row}")
            load = row["load"]["open"]
            ours.append(load["cpu_ms"]["min"])
            walls.append(load["wall_ms"]["min"])
            for name in peers:
                theirs[name].append(run([sys.executable, "-c", PEER.format(read=READ[name]), path]))
        failed = {name: all[0] for name, all in theirs.items() if isinstance(all[0], str)}
        good = {name: all for name, all in theirs.items() if name not in failed}
        median = lambda all, key: statistics.median(one[key] for one in all)
        mine, wall = statistics.median(ours), statistics.median(walls)
        said = [f"{name} {median(all, 'cpu_ms'):.1f} ({median(all, 'wall_ms'):.1f})" for name, all in good.items()]
        said += [f"{name}: {why}" for name, why in failed.items()]
        ratio = lambda own, key: f"{own / min(median(all, key) for all in good.values()):.2f}" if good else ""
        print(f"| {what} | {mine:.1f} ({wall:.1f}) | {', '.join(said)} | {ratio(mine, 'cpu_ms')} | {ratio(wall, 'wall_ms')} |", flush=True)


def versions():
    import numpy
    print(f"\nnumpy {numpy.__version__}, " + ", ".join(f"{name} {version(name)}" for name in ("nibabel", "SimpleITK", "pydicom", "tifffile", "zarr", "h5py")))


def version(name):
    from importlib.metadata import version
    return version(name)


main()
