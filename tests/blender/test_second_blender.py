# SPDX-License-Identifier: GPL-3.0-or-later
"""What a second Blender has Cycles tell is what this one's does, to the bit; and nothing of it stays."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterator
from itertools import repeat
from pathlib import Path

import bpy
import numpy as np
import pytest

from radiosity_addon.blender.reading import light_records, second_blender
from radiosity_addon.blender.reading.cycles import Cycles
from radiosity_addon.blender.reading.cycles_shader import CyclesShader
from radiosity_addon.blender.reading.extract import extract_scene, read_scene
from radiosity_addon.blender.reading.second_blender import Failed, SecondBlender
from radiosity_addon.blender.reading.subject import Subject, hand_over
from radiosity_addon.chunks import finish
from tests.blender.datablocks import differences, snapshot
from tests.blender.shader_trees import Tree, emitting, image, layout_of, of_image, plane

SPOTS = np.random.default_rng(1).random((4, 4, 3))
OTHER_SPOTS = np.float32(np.concatenate([1 - SPOTS, np.ones((4, 4, 1))], axis=2)).ravel()


@pytest.fixture(scope="module")
def second() -> Iterator[SecondBlender]:
    with SecondBlender() as blender:
        yield blender


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    """The folder of the open file."""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "room.blend"))
    return tmp_path


class Watched(SecondBlender):
    """One that has this process do nothing of what it was asked."""

    def __init__(self, other: SecondBlender) -> None:
        self.other = other
        self.done = 0

    path = property(lambda self: self.other.path)

    def ask(self, work: Callable[..., Generator[object, None, object]], *arguments: object) -> object:
        result = self.other.ask(work, *arguments)
        self.done += 1
        return result


def looks(cycles: Cycles) -> dict[str, np.ndarray]:
    """What each object emits."""
    extraction = extract_scene(bpy.context.scene)
    everything = np.ones(len(extraction.scene.meshes), bool)
    shown = CyclesShader(bpy.context.scene.name, extraction, cycles)(layout_of(extraction), everything, "emission")
    return {source.object_name: page for source, page in zip(extraction.sources, shown, strict=True)}


def of_generated(tree: Tree) -> bpy.types.NodeSocket:
    made = bpy.data.images.new("Generated", 16, 16)
    made.generated_type = "COLOR_GRID"
    return of_image(made)(tree)


def of_packed(tree: Tree) -> bpy.types.NodeSocket:
    made = image("Packed", SPOTS)
    made.pack()
    return of_image(made)(tree)


def of_repainted(tree: Tree) -> bpy.types.NodeSocket:
    """Packed, and painted again since."""
    made = image("Repainted", SPOTS)
    made.pack()
    made.pixels.foreach_set(OTHER_SPOTS)
    return of_image(made)(tree)


def saved_image(path: Path) -> bpy.types.Image:
    """Spots in a file, named relative to the open one."""
    made = image(path.stem, SPOTS)
    made.filepath_raw, made.file_format = str(path), "PNG"
    made.save()
    bpy.data.images.remove(made)
    return bpy.data.images.load(bpy.path.relpath(str(path)))


def of_file(tree: Tree) -> bpy.types.NodeSocket:
    return of_image(saved_image(Path(bpy.path.abspath("//file.png"))))(tree)


def of_painted_file(tree: Tree) -> bpy.types.NodeSocket:
    """Painted since it was saved."""
    shown = saved_image(Path(bpy.path.abspath("//painted file.png")))
    shown.pixels.foreach_set(OTHER_SPOTS)
    return of_image(shown)(tree)


def of_library(tree: Tree) -> bpy.types.NodeSocket:
    """A node group of another file, with an image beside that one."""
    folder = Path(bpy.path.abspath("//library"))
    folder.mkdir()
    group = bpy.data.node_groups.new("Shared", "ShaderNodeTree")
    group.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    picture = group.nodes.new("ShaderNodeTexImage")
    picture.image = saved_image(folder / "shared.png")
    group.links.new(picture.outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
    bpy.data.libraries.write(str(folder / "shared.blend"), {group}, path_remap="RELATIVE_ALL", fake_user=True)
    bpy.data.images.remove(picture.image)
    bpy.data.node_groups.remove(group)
    with bpy.data.libraries.load("//library/shared.blend", link=True) as (_, wanted):
        wanted.node_groups = ["Shared"]
    node = tree.node("Group")
    node.node_tree = bpy.data.node_groups["Shared"]
    return node.outputs[0]


def of_another_object(tree: Tree) -> bpy.types.NodeSocket:
    """Coordinates of an object that hangs on another one."""
    first, last = (bpy.data.objects.new(name, None) for name in ("First", "Last"))
    for number, thing in enumerate((first, last)):
        bpy.context.scene.collection.objects.link(thing)
        thing.rotation_euler, thing.location = (0.3, number, 0.2), (number, 0.4, 0)
    last.parent = first
    node = tree.node("TexCoord")
    node.object = last
    return node.outputs["Object"]


def of_camera(tree: Tree) -> bpy.types.NodeSocket:
    """Distances from a camera that hangs on an object."""
    holder = bpy.data.objects.new("Holder", None)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    for thing in (holder, camera):
        bpy.context.scene.collection.objects.link(thing)
    camera.parent, holder.location = holder, (0.3, 0.2, 4)
    bpy.context.scene.camera = camera
    return tree.node("CameraData").outputs["View Distance"]


def of_a_driver(tree: Tree) -> bpy.types.NodeSocket:
    """Of a size that follows the frame, by an expression that needs no Python."""
    node = tree.node("TexNoise")
    node.inputs["Scale"].driver_add("default_value").driver.expression = "frame / 10"
    return node.outputs["Color"]


def of_an_attribute(tree: Tree) -> bpy.types.NodeSocket:
    node = tree.node("Attribute")
    node.attribute_name, node.attribute_type = "tint", "OBJECT"
    return node.outputs["Color"]


SOURCES = (
    of_generated, of_packed, of_repainted, of_file, of_painted_file, of_library, of_another_object, of_camera,
    of_a_driver, of_an_attribute,
)  # fmt: skip


def test_all_that_trees_take_their_colours_from_looks_the_same(second: SecondBlender, saved: Path) -> None:
    scene = bpy.context.scene
    for number, make in enumerate(SOURCES):
        thing = plane(make.__name__, emitting(make, make.__name__))
        thing["tint"], thing.location = (0.2, 0.5, 0.9), (0.3, number, 0)
    plane("noise", emitting(lambda tree: tree.node("TexNoise").outputs["Color"], "Noise"))
    plane("apart", emitting(lambda tree: tree.node("NewGeometry").outputs["Random Per Island"], "Apart"))
    scene.frame_set(7)
    before, watched = snapshot(), Watched(second)
    there = looks(Cycles(second=watched))
    assert differences(before, snapshot()) == []
    assert watched.done == 1
    here = looks(Cycles())
    for name, page in here.items():
        assert page.any(), f"{name} is black"
        assert np.array_equal(there[name], page), name


def test_a_sky_looks_the_same(second: SecondBlender, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(light_records, "HEIGHT", 128)
    lit = bpy.context.scene.world = bpy.data.worlds.new("World")
    if lit.node_tree is None:  # before Blender 5
        lit.use_nodes = True
    tree = lit.node_tree
    background = next(node for node in tree.nodes if node.type == "BACKGROUND")
    shown = tree.nodes.new("ShaderNodeTexEnvironment")
    colors = np.full((32, 64, 3), 0.5)
    colors[20, 40] = 100
    shown.image = image("Sky", colors, float_buffer=True, is_data=True)
    tree.links.new(shown.outputs[0], background.inputs["Color"])
    scatter = tree.nodes.new("ShaderNodeVolumeScatter")
    tree.links.new(scatter.outputs[0], tree.get_output_node("CYCLES").inputs["Volume"])
    plane("Floor", None)
    watched = Watched(second)
    here, there = (
        finish(finish(read_scene(bpy.context.scene)).extraction(c)) for c in (Cycles(), Cycles(second=watched))
    )
    assert watched.done == 1
    assert here.warnings == there.warnings
    assert len(here.scene.world.sky) == len(there.scene.world.sky) > 1
    for own, other in zip(here.scene.world.sky, there.scene.world.sky, strict=True):
        assert np.array_equal(own.radiance, other.radiance)
        assert (own.west, own.east, own.south, own.north) == (other.west, other.east, other.south, other.north)


def driven_by_python(tree: Tree) -> bpy.types.NodeSocket:
    node = tree.node("TexNoise")
    node.inputs["Scale"].driver_add("default_value").driver.expression = "len(str(frame))"
    return node.outputs["Color"]


def in_painted_tiles(tree: Tree) -> bpy.types.NodeSocket:
    made = bpy.data.images.new("Tiles", 4, 4, tiled=True)
    made.pixels.foreach_set(OTHER_SPOTS)
    return of_image(made)(tree)


@pytest.mark.parametrize("make", [driven_by_python, in_painted_tiles])
def test_what_only_this_process_knows_is_not_handed_over(
    make: Callable[[Tree], bpy.types.NodeSocket], tmp_path: Path
) -> None:
    subject = Subject({"0": emitting(make)}, 1, 0.0)
    assert finish(hand_over(subject, tmp_path / "subject.blend")) is None
    assert list(tmp_path.iterdir()) == []


def chequered() -> None:
    plane("Floor", emitting(lambda tree: tree.node("TexChecker").outputs["Color"]))


@pytest.mark.parametrize("worker", ["raise SystemExit(1)", "import time; time.sleep(60)", "print('nonsense')"])
def test_the_work_is_done_here_where_a_second_blender_does_not_start(
    worker: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = tmp_path / "worker.py"
    script.write_text(worker)
    monkeypatch.setattr(second_blender, "WORKER", script)
    monkeypatch.setattr(second_blender, "START_SECONDS", 1.0)
    chequered()
    with SecondBlender() as broken:
        assert looks(Cycles(second=broken))["Floor"].any()


def alive(process: int) -> bool:
    """Whether a process runs; a zombie does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_one_that_is_ended_at_work_leaves_nothing(tmp_path: Path) -> None:
    heard: list[str] = []

    def asking() -> None:
        try:
            second.ask(repeat, handed)  # without end
        except Failed as failure:
            heard.append(str(failure))

    with SecondBlender() as second:
        second.start()
        handed = finish(hand_over(Subject({}, 1, 0.0), second.path))
        waiting = threading.Thread(target=asking)
        waiting.start()
        folder, process = second.path.parent, second._child.pid
        while not second._ready:
            time.sleep(0.01)
        time.sleep(0.1)
        assert not heard
    waiting.join(5)
    assert len(heard) == 1
    assert not alive(process)
    assert not folder.exists()


STARTS = """
import os, sys
import bpy
from radiosity_addon.blender.reading.second_blender import SecondBlender
second = SecondBlender()
second.start()
second._await(second._child)
print(second._child.pid, second.path.parent, flush=True)
os.kill(os.getpid(), 9)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_one_whose_first_blender_is_killed_ends_and_leaves_nothing() -> None:
    done = subprocess.run([sys.executable, "-c", STARTS], capture_output=True, text=True, check=False)
    process, folder = done.stdout.splitlines()[-1].split()
    end = time.monotonic() + 10
    while (alive(int(process)) or Path(folder).exists()) and time.monotonic() < end:
        time.sleep(0.02)
    assert not alive(int(process))
    assert not Path(folder).exists()
