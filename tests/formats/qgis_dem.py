"""Elevation models against QGIS, which makes rasters of meshes by itself (native:meshrasterize): each pixel of ours, and of tiles, is
within 0.00001, or one step of a 32-bit float, of QGIS's from the PLY of the same mesh. QGIS takes heights at the upper left corner of a pixel, so its extent is moved by half
a pixel to the east and to the south. Without QGIS this is skipped by name."""
import glob
import os
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e"))
import e2e  # noqa: E402
from e2e import Daemon, Folder, expect  # noqa: E402

os.environ["QT_QPA_PLATFORM"] = "offscreen"
try:
    import numpy
    from osgeo import gdal
    from qgis.analysis import QgsNativeAlgorithms
    from qgis.core import (QgsApplication, QgsCoordinateReferenceSystem, QgsMeshLayer, QgsProcessingContext, QgsProcessingFeedback,
                           QgsProject)
except ImportError as missing:
    e2e.skip("QGIS is not installed (python3-qgis, qgis-providers): %s" % missing)
gdal.UseExceptions()
QgsApplication.setPrefixPath("/usr", True)
APP = QgsApplication([], False)
APP.initQgis()
QgsApplication.processingRegistry().addProvider(QgsNativeAlgorithms())
EPSG = 25832


def by_qgis(ply, tif, cell, out):
    """QGIS's heights at the centres of the pixels of a GeoTIFF."""
    layer = QgsMeshLayer(ply, "m", "mdal")
    expect(layer.isValid(), "QGIS cannot read %s" % ply)
    layer.setCrs(QgsCoordinateReferenceSystem.fromEpsgId(EPSG))
    QgsProject.instance().addMapLayer(layer)
    context = QgsProcessingContext()
    context.setProject(QgsProject.instance())
    g, half = tif.GetGeoTransform(), cell / 2
    extent = (g[0] + half, g[0] + tif.RasterXSize * cell + half, g[3] - tif.RasterYSize * cell - half, g[3] - half)
    _, good = QgsApplication.processingRegistry().algorithmById("native:meshrasterize").run(
        {"INPUT": layer.id(), "DATASET_GROUPS": [0], "DATASET_TIME": {"type": "static"},
         "EXTENT": "%.6f,%.6f,%.6f,%.6f [EPSG:%d]" % (*extent, EPSG), "PIXEL_SIZE": cell, "OUTPUT": out}, context, QgsProcessingFeedback())
    expect(good, "native:meshrasterize failed")
    band = gdal.Open(out)
    expect((band.RasterXSize, band.RasterYSize) == (tif.RasterXSize, tif.RasterYSize), "QGIS made %d x %d" % (band.RasterXSize, band.RasterYSize))
    heights = band.ReadAsArray().astype("f8")
    heights[heights == band.GetRasterBand(1).GetNoDataValue()] = numpy.nan
    return heights


def ours(tif):
    heights = tif.ReadAsArray().astype("f8")
    heights[heights == -9999] = numpy.nan
    return heights


def same_heights():
    with Folder() as base, Daemon(base) as d:
        las, ply = base + "/s.las", base + "/m.ply"
        e2e.run([e2e.SYNTH, "--points", 60000, "--density", 1, "--seed", 11, las]).ok()
        d.ctl("mesh", las, "-o", ply).ok()
        for cell in (1, 0.5):  # not 0.7: QGIS rounds the number of pixels, and moves them
            d.ctl("mesh", las, "-o", base + "/m.tif", "--cell", cell).ok()
            d.ctl("mesh", las, "-o", base + "/tiles", "--format", "tif", "--cell", cell, "--tile", 100).ok()
            for n, name in enumerate([base + "/m.tif"] + sorted(glob.glob(base + "/tiles/*.tif"))[:3]):
                tif = gdal.Open(name)
                a, b = ours(tif), by_qgis(ply, tif, cell, "%s/q%s-%d.tif" % (base, cell, n))
                both = ~numpy.isnan(a) & ~numpy.isnan(b)
                worst = numpy.abs(a - b)[both].max()
                step = max(1e-5, float(numpy.spacing(numpy.float32(numpy.abs(a[both]).max()))))
                only = int((numpy.isnan(a) != numpy.isnan(b)).sum())  # centres on the hull
                expect(both.sum() > 1000 and worst <= step, "%s: %d pixels, %g at most" % (name, both.sum(), worst))
                expect(only <= 2, "%s: %d pixels are in one of them only" % (name, only))
                print("     %d pixels of %s, cell %s: at most %.2g from QGIS" % (both.sum(), os.path.basename(name), cell, worst))


e2e.main(same_heights)
