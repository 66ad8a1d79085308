"""`neugrasp capture`: the photos of a cell as a scene folder, for those who plan elsewhere."""

from __future__ import annotations

from pathlib import Path

from neugrasp.data.scene_folder import write_scene
from neugrasp.errors import InputError
from neugrasp.evaluation.run import photographer_for
from neugrasp.evaluation.workers import open_runner
from neugrasp.observation import with_backgrounds
from neugrasp.operation.command import Capture, Run
from neugrasp.operation.hardware import empty_folder, opened
from neugrasp.operation.run import THREADS, checked_cell, evaluation_of
from neugrasp.robot.wrist_camera import Photographs, read_empty, write_empty
from neugrasp.terminal import next_step


def run(config: Capture) -> str:
    """`neugrasp capture`: where the photos are, and what to do next."""
    cell = checked_cell(config.cell, config.speed)
    if config.empty:
        if cell.is_twin:
            raise InputError(f"{config.cell}: --empty is for hardware; a twin knows its empty table")
        folder = empty_folder(cell)
        with opened(cell) as hardware:
            write_empty(folder, hardware.camera.shots(), cell.camera)
        return f"{folder}\n{next_step('capture', config.cell, '--out', config.out)}"
    if (config.out / "scene.json").exists():
        raise InputError(f"{config.out}: holds a scene already; choose another --out")
    if config.out.exists() and not config.out.is_dir():
        raise InputError(f"{config.out}: is a file; the scene is written into a folder of this name")
    # What refuses to be written to does so before anything moves.
    config.out.mkdir(parents=True, exist_ok=True)
    if cell.is_twin:
        asked = evaluation_of(Run(config.cell, config.out, samples=config.samples), cell)
        with open_runner(asked, photographer_for(asked), THREADS, speed=config.speed) as runner:
            seen = runner.capture(0)
    else:
        empty = read_empty(empty_folder(cell), cell.camera)
        with opened(cell) as hardware:
            seen = Photographs(hardware.camera, empty).capture()
    write_scene(Path(config.out), with_backgrounds(seen))
    return "\n".join(
        [
            str(config.out),
            next_step("doctor", config.out),
            next_step("predict", config.out, "--out", "outputs/cell"),
        ]
    )
