"""VTK's own reader of CGNS files, as another opinion."""

import pytest


def patches_by_vtk(path):
    """Areas of patches and the volume, as VTK's reader and its own cells have them."""
    reader = pytest.importorskip("vtkmodules.vtkIOCGNSReader").vtkCGNSReader()
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersVerdict import vtkCellSizeFilter

    reader.SetFileName(str(path))
    reader.UpdateInformation()
    reader.EnableAllBases()
    reader.EnableAllFamilies()
    reader.LoadBndPatchOn()
    reader.SetDoublePrecisionMesh(1)
    reader.Update()
    found = {"Area": {}, "Volume": {}}

    def collect(data, name):
        if data.IsA("vtkMultiBlockDataSet"):
            for i in range(data.GetNumberOfBlocks()):
                collect(data.GetBlock(i), data.GetMetaData(i).Get(data.NAME()))
            return
        sizes = vtkCellSizeFilter()
        sizes.SetInputData(data)
        sizes.Update()
        for kind, own in found.items():
            own[name] = float(vtk_to_numpy(sizes.GetOutput().GetCellData().GetArray(kind)).sum())

    collect(reader.GetOutput(), "")
    volume = sum(found["Volume"].values())
    return {name: area for name, area in found["Area"].items() if area}, volume
