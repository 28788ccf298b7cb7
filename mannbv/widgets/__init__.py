"""Explorers: pictures that a hand moves, in JupyterLab and under Voilà."""

from mannbv.widgets.agreement import agreement
from mannbv.widgets.bound import lower_bound
from mannbv.widgets.camera import splat_and_camera
from mannbv.widgets.explorer import Explorer
from mannbv.widgets.information import information_over_yaw
from mannbv.widgets.masks import masks_along_a_path
from mannbv.widgets.messages import messages
from mannbv.widgets.paths import risk_weight
from mannbv.widgets.player import player
from mannbv.widgets.replay import replay
from mannbv.widgets.risk import risk_field
from mannbv.widgets.walk import walk

__all__ = [
    "Explorer",
    "agreement",
    "information_over_yaw",
    "lower_bound",
    "masks_along_a_path",
    "messages",
    "player",
    "replay",
    "risk_field",
    "risk_weight",
    "splat_and_camera",
    "walk",
]
