"""OpenSim's XML files through the standard library, with document types refused."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from scaling_service.core.errors import FileUnreadable


def parse_xml(path: Path) -> Element:
    """The root element of an XML file.

    Raises FileUnreadable if the file is absent, empty, not well-formed, or declares a document type or
    entities, which OpenSim's files never do and which can be abused to read other files or fill the memory.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FileUnreadable(
            f"cannot be opened ({error.strerror})", file=path, remedy="Check its path and its permissions"
        ) from error
    if not content.strip():
        raise FileUnreadable("the file is empty", file=path, remedy="Save or copy it again")
    # UTF-16 spreads the characters with zero bytes; without them the keywords cannot hide.
    plain = content.replace(b"\x00", b"").upper()
    if b"<!DOCTYPE" in plain or b"<!ENTITY" in plain:
        raise FileUnreadable(
            "declares a document type or entities, which is refused",
            file=path,
            remedy="Remove the DOCTYPE and ENTITY declarations",
        )
    try:
        return ElementTree.fromstring(content)
    except ElementTree.ParseError as error:
        raise FileUnreadable(
            f"is not well-formed XML ({error})", file=path, remedy="Export or save it again from OpenSim"
        ) from error
