"""A sound tetrahedron in each format of surfaces but STL."""

from __future__ import annotations

import base64
import struct
import zlib

CORNERS = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
FACES = ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))


def surfaces() -> dict[str, bytes]:
    """Name to content."""
    return {"a.ply": ply(), "a.obj": obj(), "a.vtp": vtp(), "b.vtp": vtp(inflated=len(_coordinates()))}


def ply() -> bytes:
    header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    corners = "".join(f"{x} {y} {z}\n" for x, y, z in CORNERS)
    return (header + corners + "".join(f"3 {a} {b} {c}\n" for a, b, c in FACES)).encode()


def obj() -> bytes:
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS]
    return "\n".join([*lines, *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in FACES), ""]).encode()


def vtp(inflated: int | None = None) -> bytes:
    """A VTP file as text; or its points compressed, said to be so many bytes when they are inflated.

    Notes
    -----
    Layout: VTK file formats, "XML file formats"; a compressed array begins with the number of blocks, their
    size when inflated, the size of the last one if it is smaller, and the compressed sizes.
    """
    if inflated is None:
        points = b'<DataArray type="Float32" NumberOfComponents="3" format="ascii">'
        points += " ".join(f"{v:g}" for corner in CORNERS for v in corner).encode()
        kind = b""
    else:
        packed = zlib.compress(_coordinates())
        header = struct.pack("<4Q", 1, inflated, 0, len(packed))
        points = b'<DataArray type="Float32" NumberOfComponents="3" format="binary">'
        points += base64.b64encode(header) + base64.b64encode(packed)
        kind = b' header_type="UInt64" compressor="vtkZLibDataCompressor"'
    corners = " ".join(str(k) for face in FACES for k in face).encode() + b" "
    return (
        b'<?xml version="1.0"?><VTKFile type="PolyData" version="1.0" byte_order="LittleEndian"' + kind + b">"
        b'<PolyData><Piece NumberOfPoints="4" NumberOfVerts="0" NumberOfLines="0" NumberOfStrips="0" '
        b'NumberOfPolys="4"><Points>' + points + b"</DataArray></Points><Polys>"
        b'<DataArray type="Int64" Name="connectivity" format="ascii">' + corners + b"</DataArray>"
        b'<DataArray type="Int64" Name="offsets" format="ascii">3 6 9 12</DataArray>'
        b"</Polys></Piece></PolyData></VTKFile>"
    )


def _coordinates() -> bytes:
    return struct.pack("<12f", *(v for corner in CORNERS for v in corner))
