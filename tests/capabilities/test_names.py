"""Names that options take without importing what they stand for are the names of what there is."""

from __future__ import annotations

import pytest

from scaling_service.bones.whole import BONES
from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.capabilities.shared.names import (
    BONE_NAMES,
    HIP_REGRESSION_NAMES,
    TABLE_NAMES,
    check_methods,
    list_method_names,
)
from scaling_service.model import inertia
from scaling_service.model.anatomy.hip_centre import HIP_REGRESSIONS


def test_names_are_those_of_what_there_is() -> None:
    assert list_method_names() == tuple(METHODS)
    assert tuple(HIP_REGRESSIONS) == HIP_REGRESSION_NAMES
    assert BONES == BONE_NAMES
    assert inertia.TABLE_NAMES == TABLE_NAMES


@pytest.mark.parametrize("methods", [["MB", "MB"], [], ["MBB"]])
def test_methods_that_cannot_be_compared_are_refused(methods: list[str]) -> None:
    with pytest.raises(ValueError, match="method"):
        check_methods(methods)
