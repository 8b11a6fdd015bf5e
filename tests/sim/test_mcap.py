"""A run as MCAP: what is read back is what was recorded."""

from __future__ import annotations

import io
import json
from collections import defaultdict
from typing import Any

import jsonschema
import numpy as np
import pytest

from koord.runtime.motion.world import Box, Disc, Polygon, World
from koord.sim.files.mcap import PartRecord, mcap_of
from koord.sim.run_log import SHARED, Header, RunLog, RunLogger, turns_of
from tests.sampling import first
from tests.sim.recorded import lineform, task

pytest.importorskip("mcap")

from mcap.reader import make_reader


class Read:
    """A file that was read: the messages of each topic, in order, with their times in seconds."""

    def __init__(self, raw: bytes) -> None:
        reader = make_reader(io.BytesIO(raw))
        self.topics: dict[str, list[tuple[float, Any]]] = defaultdict(list)
        self.schemas: dict[str, tuple[str, Any]] = {}
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            self.schemas[channel.topic] = schema.name, json.loads(schema.data)
            found = json.loads(message.data)
            self.topics[channel.topic].append((message.log_time / 1e9, found))
        self.facts = {one.name: one.metadata for one in reader.iter_metadata()}
        self.files = {one.name: one.data.decode() for one in reader.iter_attachments()}


@pytest.fixture(scope="module")
def recording() -> RunLog:
    return task().recording


@pytest.fixture(scope="module")
def read(recording: RunLog) -> Read:
    return Read(mcap_of(recording))


def test_transforms_are_the_poses(recording: RunLog, read: Read) -> None:
    assert read.schemas["/tf"][0] == "foxglove.FrameTransforms"
    times = [time_s for time_s, _ in read.topics["/tf"]]
    assert np.allclose(times, recording.times_s)
    for (_, message), poses in zip(read.topics["/tf"], recording.poses, strict=True):
        for robot, transform in enumerate(message["transforms"]):
            assert transform["child_frame_id"] == f"robot {robot}"
            here = [transform["translation"][axis] for axis in "xyz"]
            assert np.allclose(here, poses[robot, :3], atol=6e-4)
            turn = transform["rotation"]
            told = [turn[axis] for axis in "wxyz"]
            assert np.allclose(told, turns_of(poses)[robot], atol=6e-4)


def test_transforms_are_rounded_as_numbers_are(recording: RunLog, read: Read) -> None:
    """All of every message, to the last digit."""
    for time_s, poses, (_, message) in zip(
        recording.times_s, recording.poses, read.topics["/tf"], strict=True
    ):
        at = {"sec": round(time_s * 1e9) // 10**9, "nsec": round(time_s * 1e9) % 10**9}
        told = [
            {
                "timestamp": at,
                "parent_frame_id": "world",
                "child_frame_id": f"robot {robot}",
                "translation": {a: round(v, 3) for a, v in zip("xyz", pose, strict=False)},
                "rotation": {a: round(v, 3) for a, v in zip("wxyz", turn, strict=True)},
            }
            for robot, (pose, turn) in enumerate(
                zip(poses.tolist(), turns_of(poses).tolist(), strict=True)
            )
        ]
        assert message == {"transforms": told}


def test_paths_are_lines_of_their_robots(recording: RunLog, read: Read) -> None:
    curved = [path for path in recording.paths if len(path.points) > 2]
    assert curved
    told = [scene["entities"][0] for _, scene in read.topics["/paths"]]
    for path in curved:
        (entity,) = (
            one
            for one in told
            if one["id"] == f"path {path.robot}"
            and one["timestamp"]["sec"] + one["timestamp"]["nsec"] / 1e9
            == pytest.approx(path.time_s)
        )
        (line,) = entity["lines"]
        points = [[round(v, 3) for v in point] for point in path.points.tolist()]
        assert [[point[axis] for axis in "xyz"] for point in line["points"]] == points


def test_a_file_that_grows_says_the_same(recording: RunLog, read: Read) -> None:
    file, grown = io.BytesIO(), RunLogger(recording.header).recording
    part = PartRecord(grown, file)
    for share in (0.3, 0.31, 1.0):
        for name in ("times_s", "poses", "separations_m", "rounds", "paths", "tasks", "still"):
            every = getattr(recording, name)
            setattr(grown, name, every[: int(share * len(every))])
        part.grow()
    found = Read(file.getvalue()).topics
    assert found == read.topics


def test_rounds_say_who_ran_what(recording: RunLog, read: Read) -> None:
    events = recording.header.agents[0].events
    for done, (time_s, message) in zip(recording.rounds, read.topics["/rounds"], strict=True):
        assert time_s == pytest.approx(done.time_s)
        assert message["round"] == done.number
        deeds = done.deeds.tolist()
        ran = {one["robot"]: one["event"] for one in message["ran"]}
        assert ran == {k: events[deed] for k, deed in enumerate(deeds) if deed >= 0}
        assert message["blocked"] == [k for k, deed in enumerate(deeds) if deed == -2]


def test_changes_have_names(recording: RunLog, read: Read) -> None:
    changes = [c for _, message in read.topics["/shared"] for c in message["changes"]]
    assert len(changes) == sum(c.robot == SHARED for r in recording.rounds for c in r.changes)
    assigned = [c for c in changes if c["variable"] == "list" and "index" in c]
    assert sorted(c["index"] for c in assigned) == list(range(6))
    tasks = recording.header.world.tasks
    for change in assigned:
        assert change["value"]["assigned"] is True
        assert tuple(change["value"]["loc"].values()) == tasks[change["index"]]
    own = [c for _, message in read.topics["/local"] for c in message["changes"]]
    assert {"robot": 0, "variable": "isOnTask", "value": True} in own


def test_the_scene_has_robots_tasks_and_their_states(read: Read) -> None:
    first, *later = [message for _, message in read.topics["/scene"]]
    names = {entity["id"] for entity in first["entities"]}
    assert {"bounds", "robot 0", "robot 2", "task 0", "task 5"} <= names
    done = [entity["id"] for message in later for entity in message["entities"]]
    assert sorted(done)[0] == "task 0"
    assert all(message["entities"][0]["spheres"] for message in later)


def test_messages_are_of_their_schemas(read: Read) -> None:
    for topic, messages in read.topics.items():
        _, schema = read.schemas[topic]
        for _, message in messages[:20]:
            jsonschema.validate(message, schema)


def test_the_program_belongs_to_the_file(recording: RunLog, read: Read) -> None:
    assert read.files == {"task.krd": recording.header.text}
    assert read.facts["koord"]["ending"] == "all robots have stopped"


def test_violations_are_errors_in_the_log(recording: RunLog) -> None:
    recorder = RunLogger(recording.header)
    recorder.violation(1.5, "separation", "too near", (0, 1))
    ((time_s, message),) = Read(mcap_of(recorder.recording)).topics["/log"]
    assert (time_s, message["level"]) == (1.5, 4)
    assert message["message"] == "separation: too near"


def test_obstacles_are_cubes_cylinders_and_lines() -> None:
    obstacles = (Box((1, 1, 0), (2, 3, 1)), Disc((4, 4), 0.5), Polygon(((5, 5), (7, 5), (6, 6))))
    world = World((0, 0, 0), (8, 8, 3), obstacles)
    recording = RunLogger(Header("c.krd", "", 0.1, 0, world, (), (), ())).recording
    ((_, scene),) = Read(mcap_of(recording)).topics["/scene"]
    bounds, box, disc, polygon = scene["entities"]
    assert len(bounds["lines"][0]["points"]) == 24  # twelve edges
    assert box["cubes"][0]["size"] == {"x": 1, "y": 2, "z": 1}
    assert disc["cylinders"][0]["size"] == {"x": 1, "y": 1, "z": 3}
    assert [len(line["points"]) for line in polygon["lines"]] == [4, 4, 6]


@pytest.mark.parametrize("rounds", first(1, [120, 1200]))
def test_16_robots_and_two_minutes_are_less_than_a_megabyte(rounds: int) -> None:
    assert len(mcap_of(lineform(16, rounds).recording)) < 100_000 + 750 * rounds
