"""What runs in a process of its own, by this file's path: nothing is imported before a function asks for it."""

import json
import sys
import time
from pathlib import Path


def first() -> dict[str, float]:
    """Seconds from the first import to the first image, and then to the first gradient and information.

    torch and mannbv: their imports. render, backward, fisher: the first call of each. cpu: of the process, Python's own
    start included, until the first image.
    """
    marks = [time.perf_counter()]
    import torch

    marks.append(time.perf_counter())
    from mannbv import geometry, information, render
    from mannbv.camera import Camera
    from mannbv.splats import SplatMap

    marks.append(time.perf_counter())
    turns = geometry.identity_rotations(100, 3)
    parts = [torch.rand(100, 3), torch.full((100, 3), -3.0), turns, torch.zeros(100), torch.rand(100, 3)]
    some = SplatMap(*(part.requires_grad_() for part in parts))
    camera, pose = Camera.from_fov(64, 64), geometry.yaw_pose([-1.0, 0.5, 0.5], 0.0)
    drawn = render.render(some, camera, pose)
    marks.append(time.perf_counter())
    cpu = time.process_time()
    drawn.color.sum().backward()
    marks.append(time.perf_counter())
    with torch.no_grad():
        information.fisher(some, camera, pose)
    marks.append(time.perf_counter())
    names = ("torch", "mannbv", "render", "backward", "fisher")
    shares = {name: after - before for name, before, after in zip(names, marks[:-1], marks[1:], strict=True)}
    return shares | {"cpu": cpu}


def memory(n_splats: str, size: str) -> dict[str, float]:
    """The peak of this process [B] after a rendering with gradients and its information, where it is known."""
    from mannbv.lab.bench.calls import whole_calls

    for call in whole_calls(int(n_splats), int(size)):
        call()
    peak = _peak()
    return {} if peak is None else {"peak": peak}


def _peak() -> float | None:
    status = Path("/proc/self/status")
    if status.exists():  # Linux: getrusage would begin with the peak of the process that started this one
        held = dict(line.split(":", 1) for line in status.read_text().splitlines())
        return 1024.0 * int(held["VmHWM"].split()[0])
    try:
        import resource
    except ImportError:  # Windows
        return None
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) * (1 if sys.platform == "darwin" else 1024)


if __name__ == "__main__":
    print(json.dumps({"first": first, "memory": memory}[sys.argv[1]](*sys.argv[2:])))
