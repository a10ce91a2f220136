"""Label maps of bones: what a segmentation of an image writes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import nibabel
import numpy as np
from pyvista import PolyData, wrap
from vtkmodules.util.vtkConstants import VTK_UNSIGNED_CHAR
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkImagingStencil import vtkImageStencil, vtkPolyDataToImageStencil

from tests.bones.bones import Mesh


def write_labels(
    file: Path, labels: Mapping[str, Mesh], spacing: tuple[float, float, float], *, room: float = 6.0
) -> dict[str, int]:
    """A map of bones in mm whose axes are right, anterior, superior; and its table beside it."""
    spots = np.vstack([vertices for vertices, _ in labels.values()])
    low = spots.min(axis=0) - room
    size = np.ceil((np.ptp(spots, axis=0) + 2 * room) / spacing).astype(int) + 1
    volume = np.zeros(size, dtype=np.uint8)
    numbers = {name: 3 + k for k, name in enumerate(labels)}
    for name, mesh in labels.items():
        volume[fill(mesh, low, spacing, size)] = numbers[name]
    affine = np.diag([*spacing, 1.0])
    affine[:3, 3] = low
    # As scanners write it: the first axis runs to the left.
    flipped = affine.copy()
    flipped[0, 0], flipped[0, 3] = -affine[0, 0], affine[0, 3] + affine[0, 0] * (size[0] - 1)
    nibabel.save(nibabel.Nifti1Image(volume[::-1], flipped), file)
    file.with_name(file.name.replace(".nii.gz", ".json")).write_text(json.dumps(numbers))
    return numbers


def fill(mesh: Mesh, low: np.ndarray, spacing: tuple[float, float, float], size: np.ndarray) -> np.ndarray:
    """Which voxels lie inside."""
    image = vtkImageData()
    image.SetSpacing(*spacing)
    image.SetOrigin(*low)
    image.SetDimensions(*map(int, size))
    image.AllocateScalars(VTK_UNSIGNED_CHAR, 1)
    image.GetPointData().GetScalars().Fill(1)
    stencil = vtkPolyDataToImageStencil()
    stencil.SetInputData(PolyData.from_regular_faces(*mesh))
    stencil.SetOutputOrigin(*low)
    stencil.SetOutputSpacing(*spacing)
    stencil.SetOutputWholeExtent(image.GetExtent())
    stencil.Update()
    cut = vtkImageStencil()
    cut.SetInputData(image)
    cut.SetStencilConnection(stencil.GetOutputPort())
    cut.SetBackgroundValue(0)
    cut.Update()
    inside = np.asarray(wrap(cut.GetOutput()).point_data.active_scalars)
    return inside.reshape(size, order="F") > 0
