#!/usr/bin/env python3
"""Reading volumes with Relume beside the usual libraries of Python, as a Markdown table.

  benches/readers.py --relume target/release/relume > benches/results/readers.md

Needs numpy, nibabel, SimpleITK, pydicom (with pylibjpeg, pylibjpeg-openjpeg, pylibjpeg-libjpeg, pyjpegls), tifffile,
imagecodecs, zarr and h5py. The volumes are made by these libraries: 256 x 256 x 128 voxels of 16 bits, smooth with noise.
Each reading is a process of its own, in turn (A B A B ...); CPU ms (user and system) of all threads, of the fastest of five
readings after one to warm up, and the median of the processes. The start of a process counts on neither side. Wall time is
what both cores take together.
"""
import argparse, json, os, platform, shutil, statistics, subprocess, sys, tempfile

DIMS = (128, 256, 256)

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


def volume():
    import numpy
    z, y, x = numpy.indices(DIMS)
    smooth = 900 + 600 * numpy.sin(x / 19) * numpy.cos(y / 23) * numpy.sin(z / 17)
    return (smooth + numpy.random.default_rng(1).integers(0, 30, DIMS)).astype("uint16")


def make(folder):
    """Writes the files; returns (what, path, names of peers)."""
    import h5py, nibabel, numpy, tifffile, zarr
    data, made = volume(), []

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
        array = zarr.create_array(path, shape=DIMS, chunks=(64, 64, 64), dtype="uint16", compressors=[codec] if codec else None)
        array[...] = data
    for compression in ["gzip", "lzf"]:
        path = add(f"HDF5, {compression}, shuffle", f"{compression}.h5", "h5py")
        with h5py.File(path, "w") as file:
            file.create_dataset("volume", data=data, chunks=(64, 64, 64), compression=compression, shuffle=True)
    dicom(folder, data, add)
    return made


def dicom(folder, data, add):
    import imagecodecs, pydicom
    from pydicom.encaps import encapsulate
    from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, JPEG2000Lossless, JPEGLosslessSV1, JPEGLSLossless, RLELossless, generate_uid

    codings = {
        "uncompressed": (ExplicitVRLittleEndian, None),
        "RLE": (RLELossless, None),
        "JPEG lossless": (JPEGLosslessSV1, lambda image: imagecodecs.ljpeg_encode(image, bitspersample=16)),
        "JPEG-LS": (JPEGLSLossless, imagecodecs.jpegls_encode),
        "JPEG 2000": (JPEG2000Lossless, lambda image: imagecodecs.jpeg2k_encode(image, codecformat="j2k", level=0, reversible=True)),
    }
    for what, (syntax, encode) in codings.items():
        path = add(f"DICOM, {what}", what.replace(" ", "_"), "pydicom", "SimpleITK series")
        os.makedirs(path)
        series, study, frame = generate_uid(), generate_uid(), generate_uid()
        for z, image in enumerate(data):
            meta = pydicom.dataset.FileMetaDataset()
            meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID = CTImageStorage, generate_uid()
            meta.TransferSyntaxUID = ExplicitVRLittleEndian if what == "RLE" else syntax
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
            if what == "RLE":
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
    given = arguments.parse_args()
    folder = tempfile.mkdtemp()
    try:
        table(make(folder), os.path.abspath(given.relume), given)
    finally:
        shutil.rmtree(folder)


def table(made, relume, given):
    import numpy
    cpu = next((line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), platform.machine())
    print(f"{' x '.join(map(str, reversed(DIMS)))} voxels of 16 bits; {cpu}, {os.cpu_count()} cores; {given.build} build of Relume.")
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
    print(f"\nnumpy {numpy.__version__}, " + ", ".join(f"{name} {version(name)}" for name in ("nibabel", "SimpleITK", "pydicom", "tifffile", "zarr", "h5py")))


def version(name):
    from importlib.metadata import version
    return version(name)


main()
