# SPDX-License-Identifier: GPL-3.0-or-later
"""A Blender with a window, used as a person does: looks at its pictures, moves the mouse, presses keys.

Nothing waits for a fixed time: a window drawn by software on a busy machine takes a second for a picture, or many.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from PIL import Image

from tests.desktop.blender import ROOT, Desktop

T = TypeVar("T")

PATIENCE = 240.0
"""Seconds after which what is waited for is taken to never come."""
ENDING = 10.0
"""Seconds for a screen to end in order."""
HOVERING = 5.0
"""Seconds until a button, if it is one, has seen that the mouse is over it."""
HELD = 0.1
"""Seconds that a person takes between moving the mouse, pressing and letting go; at once, a busy window may miss it."""
GLANCE = 0.05
"""Seconds between two looks at what is waited for."""
OPERATOR_COLOR = (0x54, 0x57, 0x54)
PROGRESS_COLOR = (0x47, 0x75, 0xB3)
SLIDER_COLOR = (0x47, 0x72, 0xB0)
"""The colours that inside_window.py gives to buttons of operators, progress bars and what is filled of sliders."""
LEAST_BUTTON = 12
"""Pixels that a button has at least in both directions."""
SAME = 0.5
"""Mean difference of pixels, of 255, of two pictures that show the same: EEVEE samples anew each time."""
LEAST_MARGIN = 4
"""Pixels of a button above and below what is written on it, and beside it."""
SCROLLED = 5
"""Clicks of the mouse wheel from one look to the next."""
NOWHERE = ((3, 997), (700, 600))
"""Places without buttons, in the status bar and in the 3D view."""


class Window:
    """A window of its own on a screen of its own.

    Attributes:
        folder: temporary, seen by that Blender too
        pictures: where screenshots are kept
    """

    def __init__(self, desktop: Desktop, folder: Path, pictures: Path) -> None:
        self.folder = folder
        self.pictures = pictures
        self._script = desktop.script
        self._display = free_display()
        self._environment = desktop.environment() | {"DESKTOP_BLENDER_DISPLAY": self._display}
        self._asked = 0
        self._process: subprocess.Popen[bytes] | None = None

    def open(self, *arguments: str | Path) -> None:
        """Start Blender, the sidebar's tab Radiosity and the Render properties in view."""
        tests = ROOT / "tests"
        for script in ("desktop/inside_window.py", "desktop/tutorial_steps.py", "blender/datablocks.py"):
            shutil.copy(tests / script, self.folder)
        command = [self._script, "window", *arguments, "--python", self.folder / "inside_window.py", "--", self.folder]
        with (self.folder / "window.log").open("wb") as log:
            self._process = subprocess.Popen(
                command, cwd=ROOT, env=self._environment, stdout=log, stderr=log, start_new_session=True
            )
        self.turn_to("Radiosity")

    def turn_to(self, tab: str) -> None:
        """Open the sidebar at a tab; "" closes it."""
        self.until(lambda: self.ask("arrange", tab), "the window is arranged")

    def close(self) -> None:
        """End Blender and its screen, whatever they are doing."""
        if self._process is None:
            return
        screen = Path(f"/tmp/.X11-unix/X{self._display.lstrip(':')}")
        end = time.monotonic() + ENDING
        self._signal(signal.SIGTERM)
        while screen.exists() and time.monotonic() < end:
            time.sleep(GLANCE)
        self._signal(signal.SIGKILL)
        self._process.wait()
        screen.unlink(missing_ok=True)

    def _signal(self, kind: signal.Signals) -> None:
        assert self._process is not None
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, kind)

    def ask(self, call: str, *arguments: Any) -> Any:
        """The answer of a function of inside_window.py."""
        self._asked += 1
        question = {"number": self._asked, "call": call, "arguments": arguments}
        waiting = self.folder / "question.part"
        waiting.write_text(json.dumps(question), encoding="utf-8")
        os.replace(waiting, self.folder / "question.json")
        reply = self.until(self._answer, f"an answer to {call}{arguments}")
        assert "error" not in reply, reply["error"]
        return reply["value"]

    def _answer(self) -> dict[str, Any] | None:
        assert self._process is not None
        assert self._process.poll() is None, f"Blender has quit:\n{(self.folder / 'window.log').read_text()[-4000:]}"
        path = self.folder / "answer.json"
        reply: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {"number": 0}
        return reply if reply["number"] == self._asked else None

    def until(self, looked_at: Callable[[], T | None], awaited: str) -> T:
        """Look until what is seen is something; fails with a picture of the window."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            seen = looked_at()
            if seen:
                return seen
            time.sleep(GLANCE)
        self.picture("failed")
        raise AssertionError(f"waited {PATIENCE:.0f} s until {awaited}; see {self.pictures / 'failed.png'}")

    def picture(self, name: str | None = None) -> np.ndarray:
        """What the window shows, (height, width, 3) uint8; kept under a name."""
        path = self.folder / "shot.bmp"  # quickly written, and read
        subprocess.run([self._script, "shot", path], cwd=ROOT, env=self._environment, check=True, timeout=PATIENCE)
        with Image.open(path) as image:
            if name:
                self.pictures.mkdir(parents=True, exist_ok=True)
                image.save(self.pictures / f"{name}.png")
            return np.asarray(image.convert("RGB"))

    def hands(self, *words: str | int) -> None:
        """Mouse and keyboard, in xdotool's words."""
        command = [self._script, "xdo", *map(str, words)]
        subprocess.run(command, cwd=ROOT, env=self._environment, check=True, timeout=PATIENCE, capture_output=True)

    def press(self, key: str) -> None:
        """Press and let go a key."""
        self.hands("key", key)

    def click(self, x: int, y: int) -> None:
        """Move the mouse there, press and let go its left button."""
        self.hands("mousemove", x, y, "sleep", HELD, "mousedown", 1, "sleep", HELD, "mouseup", 1)

    def click_button(self, operator: str, place: str = "sidebar") -> None:
        """Click the button that calls an operator, once the mouse is seen to be over it.

        Wait for what comes of it before the mouse moves on: a busy window takes a click that is left at once for none.
        """
        x, y = self.until(lambda: self.button(operator, place), f"a button for {operator} is in the {place}")
        self.click(x, y)

    def search(self, text: str) -> None:
        """Have the properties show what has this text, by Ctrl F, the mouse over them."""
        left, top, right, bottom = self.ask("place", "properties")
        self.hands("mousemove", (left + right) // 2, (top + bottom) // 2)
        self.press("ctrl+f")
        self.hands("type", text)
        self.press("Return")
        self.until(lambda: self.ask("state")["search"] == text, "the properties are searched")

    def scroll_to_button(self, operator: str, place: str) -> tuple[int, int]:
        """Turn the mouse wheel until the button of an operator is in sight, and the mouse over it."""

        def seen() -> tuple[int, int] | None:
            found = self.button(operator, place)
            if found is None:
                left, top, right, bottom = self.ask("place", place)
                self.hands("mousemove", (left + right) // 2, (top + bottom) // 2, *["click", 5] * SCROLLED)
            return found

        return self.until(seen, f"a button for {operator} is in the {place}")

    def set_slider(self, setting: str, text: str) -> None:
        """Type into the slider of a setting in the sidebar, the mouse over it."""
        self.until(lambda: self.slider(setting), f"a slider for {setting} is in the sidebar")
        for key in ("Return", "ctrl+a", *text, "Return"):
            self.press(key)

    def slider(self, setting: str) -> tuple[int, int] | None:
        """Where the slider of a setting is, and the mouse over it; None if it is not in sight."""
        return self._widget(SLIDER_COLOR, "pointed", setting, "sidebar")

    def button(self, operator: str, place: str = "sidebar") -> tuple[int, int] | None:
        """Where the button of an operator is, and the mouse over it; None if it is not in sight."""
        return self._widget(OPERATOR_COLOR, "hovered", operator, place)

    def _widget(self, color: tuple[int, int, int], asked: str, wanted: str, place: str) -> tuple[int, int] | None:
        self.until(lambda: not all(self.hover(spot, place, asked) for spot in NOWHERE), "no button is under the mouse")
        left, top, right, bottom = self.ask("place", place)
        seen = ""
        for x, y in rectangles((self.picture()[top:bottom, left:right] == color).all(-1)):
            spot, before, end = (left + x, top + y), seen, time.monotonic() + HOVERING
            while seen == before and time.monotonic() < end:
                seen = self.hover(spot, place, asked) or before
            if seen != before and seen.startswith(wanted):
                return spot
        return None

    def hover(self, spot: tuple[int, int], place: str, asked: str = "hovered") -> str:
        """Move the mouse there; what Blender takes to be under it, which may still be what was before."""
        self.hands("mousemove", spot[0] + 1, spot[1], "mousemove", *spot)  # a mouse that does not move says nothing
        return str(self.ask(asked, place))

    def view(self, name: str | None = None, unlike: np.ndarray | None = None) -> np.ndarray:
        """A picture of the 3D view without the sidebar, once nothing changes any more.

        Args:
            name: to keep a picture of the window under
            unlike: a view that it must no longer look like; EEVEE shows the old one until shaders are compiled
        """
        seen = [self.glance()]

        def still() -> bool:
            self.ask("redraw")
            self.ask("state")  # is answered when all is drawn
            seen.append(self.glance(name))
            new = unlike is None or not alike(seen[-1], unlike)
            return new and np.array_equal(*seen[-2:]) and not self.progress_bars()

        self.until(still, "the window no longer changes")
        return seen[-1]

    def glance(self, name: str | None = None) -> np.ndarray:
        """A picture of the 3D view without the sidebar, as it is."""
        left, top, _, bottom = self.ask("place", "view")
        right = self.ask("place", "sidebar")[0]
        return self.picture(name)[top:bottom, left:right]

    def progress_bars(self) -> int:
        """Pixels of filled progress bars in sight."""
        return bars(self.picture())


def alike(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two views show the same."""
    return bool(np.abs(one.astype(np.float32) - other).mean() < SAME)


def red(picture: np.ndarray) -> int:
    """How many pixels are red: the shaders of objects are compiled, and more than a grid is seen."""
    return int((picture[..., 0] > 1.6 * picture[..., 1].astype(np.float32) + 20).sum())


def bars(picture: np.ndarray) -> int:
    """Pixels of filled progress bars."""
    return int((picture == PROGRESS_COLOR).all(-1).sum())


def rectangles(mask: np.ndarray) -> list[tuple[int, int]]:
    """Centres (x, y) of the filled rectangles of a mask, row by row; what is written on them may leave holes."""
    return [
        ((left + right) // 2, (top + bottom) // 2)
        for top, bottom in spans(mask.sum(axis=1) >= LEAST_MARGIN)
        for left, right in spans(mask[top:bottom].sum(axis=0) >= LEAST_MARGIN)
    ]


def spans(line: np.ndarray) -> list[tuple[int, int]]:
    """First and last + 1 of what is set without a gap, as far as it is as long as a button."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(np.int8), [0]]))).tolist()
    return [(first, last) for first, last in zip(edges[::2], edges[1::2], strict=True) if last - first >= LEAST_BUTTON]


def free_display() -> str:
    """A screen that no one uses; DESKTOP_BLENDER_DISPLAY may name it."""
    named = os.environ.get("DESKTOP_BLENDER_DISPLAY")
    first = 200 + os.getpid() % 500
    numbers = [int(named.lstrip(":"))] if named else range(first, first + 500)
    free = [number for number in numbers if not Path(f"/tmp/.X11-unix/X{number}").exists()]
    assert free, f"the screen {named} is in use"
    return f":{free[0]}"
