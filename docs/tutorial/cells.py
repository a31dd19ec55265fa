"""Writes cells.ome.tif: a made stack of two channels, nuclei and membranes, with noise. Needs numpy and tifffile."""

import numpy
import tifffile

random = numpy.random.default_rng(7)
size = numpy.array([40, 96, 96])  # z, y, x
step = numpy.array([0.6, 0.25, 0.25])  # micrometres

seeds = random.uniform(0, 1, (60, 3)) * size * step
places = numpy.moveaxis(numpy.indices(size), 0, -1) * step
distances = numpy.sqrt(((places[:, :, :, None] - seeds) ** 2).sum(-1))
nearest, second = numpy.moveaxis(numpy.partition(distances, 1)[..., :2], -1, 0)

inside = numpy.sqrt((((places / (size * step) - 0.5) * 2.1) ** 2).sum(-1)) < 1
nuclei = 3000 * inside / (1 + numpy.exp((nearest - 1.5) / 0.15))
membranes = 2000 * inside * numpy.exp(-(((second - nearest) / 0.5) ** 2))
cells = random.poisson(numpy.stack([nuclei, membranes]) + 60).astype(numpy.uint16)

micrometres = dict(zip(("PhysicalSizeZ", "PhysicalSizeY", "PhysicalSizeX"), step))
names = {"Channel": {"Name": ["nuclei", "membranes"]}}
tifffile.imwrite("cells.ome.tif", cells, metadata={"axes": "CZYX", **micrometres, **names})
