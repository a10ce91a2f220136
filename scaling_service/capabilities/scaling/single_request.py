"""Requests for one method, as `scale` on the command line takes them."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from scaling_service.capabilities.scaling.request import OfRecordings


class OneMethodRequest(OfRecordings):
    """Scale a subject's model by one method."""

    method: str


class LinearRequest(OneMethodRequest):
    """Scale a subject's model in closed form: from marker distances, or from images."""

    method: Literal["MB", "EB"] = Field(
        default="MB", description="MB from marker distances, EB from bones.", examples=["MB"]
    )


class OptimisedRequest(OneMethodRequest):
    """Scale a subject's model by optimisation over its calibration trials."""

    method: Literal["MB_lam", "MB_am", "EB_am"] = Field(
        default="MB_am", description="What is free, and what it starts from.", examples=["MB_am"]
    )
