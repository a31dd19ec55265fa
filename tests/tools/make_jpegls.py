"""Writes tests/data/jpegls.bundle: codestreams of JPEG-LS by CharLS (imagecodecs), and the numbers that CharLS decodes.

    python3 tests/tools/make_jpegls.py tests/data/jpegls.bundle

Numbers of 12 bits are coded with 16. Names are BITS-NEAR-KIND.jls and .raw (16 bits, little-endian); all pictures have 31 columns and 23 rows. The bundle is as in
make_zarr.py.
"""

import struct
import sys

import imagecodecs
import numpy as np

SHAPE = (23, 31)


def pictures(bits):
    most, random = 2**bits - 1, np.random.default_rng(bits)
    y, x = np.indices(SHAPE)
    yield "noise", random.integers(0, most + 1, SHAPE)
    yield "slope", (x * 3 + y * 2 + random.integers(0, 4, SHAPE)) % (most + 1)
    yield "runs", np.where((x // 7 + y // 5) % 3 == 0, most, x // 9 * 5)
    yield "flat", np.full(SHAPE, most // 3)


def main():
    with open(sys.argv[1], "wb") as out:
        for bits in [8, 12, 16]:
            for kind, numbers in pictures(bits):
                for near in [0, 3]:
                    code = imagecodecs.jpegls_encode(numbers.astype("uint8" if bits == 8 else "uint16"), level=near)
                    raw = imagecodecs.jpegls_decode(code).astype("<u2").tobytes()
                    for ending, content in [("jls", code), ("raw", raw)]:
                        name = f"{bits}-{near}-{kind}.{ending}".encode()
                        out.write(struct.pack("<B", len(name)) + name + struct.pack("<I", len(content)) + content)


main()
