"""A recording: what an episode looked like, small enough to travel with a notebook; beside it a record without maps."""

import dataclasses
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int8, UInt8
from PIL import Image

from mannbv import archive, geometry, information, render
from mannbv.camera import Camera
from mannbv.episode import Record
from mannbv.grid import OCCUPIED, UNKNOWN, Occupancy
from mannbv.mapping import LocalMap
from mannbv.team import CycleLog, Guests, Robot, RobotLog
from mannbv.world import World

VIEWS = ("what it sees", "its map before", "its map after")
_QUALITY = 80  # of JPEG
_DIGITS = 4  # of metres and radians in a record without maps


@dataclass(frozen=True)
class Recording:
    """Pictures of c cycles of n robots.

    state (c, n, nx, ny): what each knew of the ground after its move, as `Occupancy.state`. views (c, n, 3, h, w, 3):
    what the sensor sees where the robot stood at the cycle's beginning, and what its map showed there before and after
    it had mapped its latest images; psnr (c, n, 2): of these two against the first [dB], nan for an empty map.
    """

    state: Int8[np.ndarray, "c n nx ny"]
    views: UInt8[np.ndarray, "c n 3 h w 3"]
    psnr: Float[np.ndarray, "c n 2"]

    @staticmethod
    def of(records: Sequence[Record], place: World) -> "Recording":
        """From the records of a 3-D episode after every cycle, as `episode.run` gives them to `progress`."""
        records = [record for record in records if not record.finished]
        config = records[-1].config
        camera = Camera.from_fov(config.image_width, config.image_height, config.fov)
        state, views, psnr = [], [], []
        for number, record in enumerate(records):
            robots = records[number - 1].robots if number else [None] * record.n_robots
            state.append([robot.ground.state for robot in record.robots])
            looks = [
                _looks(log, before, after, place, camera, config.max_depth)
                for log, before, after in zip(record.cycles[number].robots, robots, record.robots, strict=True)
            ]
            views.append([pictures for pictures, _ in looks])
            psnr.append([scores for _, scores in looks])
        return Recording(np.array(state), np.array(views), np.array(psnr, np.float32))

    def ground(self, cycle: int, k: int, like: Occupancy) -> Occupancy:
        """What robot k knew of the ground after a cycle's move, on the lattice of `like`."""
        state = self.state[cycle, k]
        return Occupancy(like.lattice, np.where(state == UNKNOWN, 0, np.where(state == OCCUPIED, 1, -1)).astype("f4"))

    def save(self, path: str | Path) -> None:
        """Write the recording (.npz without pickle): grounds as packed bits, views as one sheet, a JPEG."""
        c, n, _, h, w, _ = self.views.shape
        sheet = self.views.transpose(0, 3, 1, 2, 4, 5).reshape(c * h, n * len(VIEWS) * w, 3)
        jpeg = io.BytesIO()
        Image.fromarray(sheet).save(jpeg, "JPEG", quality=_QUALITY)
        bits = np.packbits(np.stack([self.state != UNKNOWN, self.state == OCCUPIED]))
        arrays = {"shape": np.array([*self.state.shape, h, w]), "ground": bits, "psnr": self.psnr}
        archive.write(path, arrays | {"views": np.frombuffer(jpeg.getvalue(), np.uint8)}, compressed=True)

    @staticmethod
    def load(path: str | Path) -> "Recording":
        """Read a recording. Raises ValueError for anything else."""
        try:
            arrays = archive.read(path)
            c, n, nx, ny, h, w = arrays["shape"].tolist()
            known, solid = np.unpackbits(arrays["ground"])[: 2 * c * n * nx * ny].reshape(2, c, n, nx, ny)
            sheet = np.array(Image.open(io.BytesIO(arrays["views"].tobytes()), formats=["JPEG"]))
            views = sheet.reshape(c, h, n, len(VIEWS), w, 3).transpose(0, 2, 3, 1, 4, 5)
            state = np.where(known, np.where(solid, OCCUPIED, 0), UNKNOWN).astype(np.int8)
            return Recording(state, views, arrays["psnr"])
        except (OSError, ValueError, TypeError, Image.DecompressionBombError) as error:
            raise ValueError(f"{path}: no recording ({error}); make it anew with tools/records.py") from None


def without_maps(record: Record) -> Record:
    """The record without maps, images and guests, places to a tenth of a millimetre: a hundredth of the bytes.

    What happened, who went where, the grounds, every byte sent and the scores stay.
    """
    robots = tuple(_without_map(robot) for robot in record.robots)
    cycles = tuple(CycleLog.from_json(_rounded(log.to_json())) for log in record.cycles)
    return dataclasses.replace(record, robots=robots, cycles=cycles, finished=True)


def _without_map(robot: Robot) -> Robot:
    dim = robot.local.splats.dim
    local, ground = LocalMap.empty(dim, information.n_parameters(dim)), robot.ground
    ground = Occupancy(ground.lattice, np.sign(ground.log_odds))
    return robot.replace(local=local, guests=Guests.none(dim), frames=(), grids={}, ground=ground)


def _rounded(value):
    if isinstance(value, dict):
        return {key: _rounded(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_rounded(part) for part in value]
    return round(value, _DIGITS) if isinstance(value, float) else value


def _looks(log: RobotLog, before: Robot | None, after: Robot, place: World, camera: Camera, max_depth: float):
    """The three pictures (3, h, w, 3) of where a robot stood, and the PSNR (2,) [dB] of the last two."""
    pose = geometry.yaw_pose(torch.tensor(log.position), log.yaw)
    truth = place.sense(camera, pose, max_depth)
    pictures, scores = [truth.color], []
    for robot in (before, after):
        if robot is None or not robot.local.splats.n_splats:
            pictures.append(torch.ones_like(truth.color))
            scores.append(math.nan)
            continue
        with torch.no_grad():
            pictures.append(render.render(robot.local.splats, camera, pose).color)
        scores.append(-10 * math.log10(((pictures[-1] - truth.color) ** 2)[truth.valid].mean().item()))
    return (255 * torch.stack(pictures).clamp(0, 1)).round().byte().numpy(), scores
