"""Crowds on the page: pictures are copied into pixels as a canvas would draw them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from koord.sim.viewing import page_of
from tests.sim.browser import Tab, browser, in_a_browser
from tests.sim.test_page import circling

pytestmark = in_a_browser

ROBOTS = 250  # more than are drawn one by one

#: Helpers within the page: a canvas and a crowd of one size, and how far they are from each other.
_HELPERS = """
    const { crowd, map } = { crowd: page.map.crowd, map: page.map };
    const canvas = made("canvas");
    const pen = fitted(canvas, map.width, map.height, true);
    const white = new Uint32Array(canvas.width * canvas.height).fill(0xffffffff);
    const begin = () => {
      pen.fillStyle = "#fff";
      pen.fillRect(0, 0, map.width, map.height);
      crowd.begin({ width: canvas.width, height: canvas.height, pixels: white });
    };
    /** The greatest difference of the means of squares of pixels, of any channel. */
    const apart = (square) => {
      const { width, height } = crowd;
      const one = pen.getImageData(0, 0, width, height).data, other = crowd.image.data;
      const across = Math.ceil(width / square), down = Math.ceil(height / square);
      const sums = new Float64Array(4 * across * down);
      for (let k = 0; k < one.length; k++) {
        const pixel = k >> 2, x = pixel % width, y = Math.floor(pixel / width);
        const to = Math.floor(y / square) * across + Math.floor(x / square);
        sums[4 * to + (k & 3)] += one[k] - other[k];
      }
      return sums.reduce((most, sum) => Math.max(most, Math.abs(sum)), 0) / square ** 2;
    };
    const shot = (time) => {
      map.draw(time, 7);
      const { width, height } = map.canvas;
      return map.canvas.getContext("2d").getImageData(0, 0, width, height).data;
    };
    const mean = (one, other) =>
      one.reduce((sum, part, k) => sum + Math.abs(part - other[k]), 0) / one.length;
    let seed = 1;
    const random = (low, high) => {
      seed = (Math.imul(seed, 1103515245) + 12345) >>> 1;
      return low + (high - low) * ((seed & 0xffff) / 0x10000);
    };
"""


def within(tab: Tab, body: str) -> Any:
    """The answer of a function that may use the helpers."""
    return tab.ask(f"(() => {{ {_HELPERS} {body} }})()")


@pytest.fixture(scope="module", params=[1, 1.5])
def tab(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tab]:
    """A page of many robots, on screens of two kinds; nothing may complain of it."""
    path = tmp_path_factory.mktemp("pages") / "many.html"
    path.write_bytes(page_of(circling(ROBOTS, 6.0)))
    with browser() as tab:
        tab.call(
            "Emulation.setDeviceMetricsOverride",
            width=1000,
            height=700,
            deviceScaleFactor=request.param,
            mobile=False,
        )
        tab.open(path.as_uri())
        tab.ask("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        yield tab
    assert tab.complaints == []


def test_pictures_are_copied_as_they_would_be_drawn(tab: Tab) -> None:
    """At any place, also over the edges; up to what shares of 256 round away."""
    found = within(
        tab,
        """
        begin();
        for (let k = 0; k < 400; k++) {
          const x = random(-30, map.width + 30), y = random(-30, map.planHeight + 30);
          const robot = k % 2, unit = 40, half = 30;
          const draw = (pen) => drawRobot(pen, map.run.robots[robot], unit, colourOf(robot));
          crowd.put(crowd.stamp(`test ${robot}`, half, draw), x, y);
          const picture = drawnOnce(half, draw), { ratio } = crowd, side = picture.width;
          pen.setTransform(1, 0, 0, 1, Math.round(x * ratio), Math.round(y * ratio));
          pen.drawImage(picture, -(side >> 1), -(side >> 1));
        }
        return [apart(1), crowd.image.data.some((part) => part !== 255)];
        """,
    )
    assert found[1]
    assert found[0] <= 4


def test_lines_are_drawn_as_a_canvas_draws_them(tab: Tab) -> None:
    """On average over a few pixels: where exactly a line ends differs."""
    found = within(
        tab,
        """
        begin();
        const colour = "#204060", ratio = crowd.ratio;
        for (let k = 0; k < 60; k++) {
          const [w, h] = [crowd.width, crowd.height];
          const ends = [random(-w, 2 * w), random(-h, 2 * h), random(-w, 2 * w), random(-h, 2 * h)];
          if (k === 0) ends[3] = ends[1]; // along the rows
          if (k === 1) ends[2] = ends[0];
          crowd.line(...ends, crowd.packed(colour), 77);
          pen.save();
          pen.setTransform(1, 0, 0, 1, 0.5, 0.5); // pixels are about their middles
          [pen.strokeStyle, pen.lineWidth, pen.globalAlpha] = [colour, 1, 77 / 256];
          pen.beginPath();
          pen.moveTo(ends[0], ends[1]);
          pen.lineTo(ends[2], ends[3]);
          pen.stroke();
          pen.restore();
        }
        const inked = crowd.image.data.reduce((sum, part) => sum + (255 - part), 0);
        return [apart(16), inked];
        """,
    )
    assert found[1] > 100_000
    assert found[0] < 3.0


@pytest.mark.parametrize("view", ["page.map.fit()", "page.map.zoom(4, 300, 200)"])
def test_a_crowd_looks_like_robots_drawn_one_by_one(tab: Tab, view: str) -> None:
    """Up to headings that are one of a few and places on whole pixels."""
    differs = within(
        tab,
        f"""
        map.fit();
        {view};
        map.shown.trails = false;
        const together = shot(3.3), empty = shot(0.4);
        map.crowd = null;
        map.forget();
        const alone = shot(3.3);
        map.crowd = crowd;
        map.forget();
        map.shown.trails = true;
        return [mean(together, alone), mean(together, empty)];
        """,
    )
    assert differs[0] < 0.25 * differs[1]


def test_pictures_are_those_of_the_scale(tab: Tab) -> None:
    """After the scale has changed, and changed back, and with another theme."""
    same = within(
        tab,
        """
        const equal = (one, other) => one.every((part, k) => part === other[k]);
        map.fit();
        const first = shot(3.3);
        map.zoom(2, 300, 200);
        const second = shot(3.3);
        page.switchTheme();
        const dark = shot(3.3);
        page.switchTheme();
        const again = shot(3.3);
        map.fit();
        return [equal(first, shot(3.3)), equal(second, again), equal(second, dark)];
        """,
    )
    assert same == [True, True, False]


def test_who_is_too_near_is_found_whatever_the_order(tab: Tab) -> None:
    safety_m = circling(ROBOTS, 0.0).header.safety_m
    for seed in (1, 2, 3):
        near, now = within(
            tab,
            f"""
            seed = {seed};
            map.now.forEach((_, k) => {{ map.now[k] = random(0, k % 4 === 2 ? 3 : 14); }});
            return [[...map.tooNear()], [...map.now]];
            """,
        )
        places = np.array(now).reshape(-1, 4)[:, :3]
        gaps = ((places[:, None] - places) ** 2).sum(2)
        np.fill_diagonal(gaps, np.inf)
        expected = gaps.min(1) < safety_m**2 - 1e-4
        assert 0 < expected.sum() < ROBOTS
        assert near == expected.astype(int).tolist()
