"""Files that are no configuration, though they are YAML or look so: what they are."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice

import yaml

from koord.runtime.configuration.reading import problem
from koord.syntax.diagnostics import Diagnostic
from koord.syntax.source import Source, Span

#: Dots where a listing leaves something out: alone, as an entry, as a value, or in a list.
_DOTS = re.compile(
    r"^\s*(?:-\s+)*(?:[\w.-]+\s*:\s*)?(\.\.\.|…)\s*(?:#.*)?$|[\[,{]\s*(\.\.\.|…)\s*[\],}]"
)

#: What NumPy prints, pasted by a script that wrote the file.
_ARRAY = re.compile(r"\barray\(\[")

#: Words by which services of continuous integration are told what to do.
_CI = {"language", "script", "install", "stages", "jobs", "steps", "pipelines", "before_script"}
_CI |= {"deploy", "dist", "env", "jdk", "matrix", "notifications", "os", "sudo"}

#: A value of a schema of Yamale: `int(min=0)`, `include('agent')`.
_RULE = re.compile(r"^(int|num|str|bool|enum|list|map|include|ip|any|regex)\(.*\)$")

_TIMESTAMP = "tag:yaml.org,2002:timestamp"


def misread(source: Source) -> tuple[Diagnostic, ...]:
    """Say of a text that cannot be read as a configuration what it is. Empty: nobody knows."""
    if dots := tuple(_left_out(source)):
        return dots
    try:
        nodes = list(islice(yaml.compose_all(source.text, Loader=yaml.SafeLoader), 2))
    except (yaml.YAMLError, RecursionError, ValueError):
        return ()
    told = _kind(nodes)
    if told is None:
        return ()
    story, hint = told
    return (problem(Span(source.name, 1, 1, 1, 1), story, hint, "K951"),)


def _left_out(source: Source) -> Iterator[Diagnostic]:
    """Find what the writer of a listing, or of a script, left out."""
    lines = source.text.splitlines()
    for number, line in enumerate(lines, 1):
        if found := _DOTS.search(line):
            group = 1 if found[1] is not None else 2
            ends = line.rstrip() == "..." and not any(
                rest.strip() and not rest.lstrip().startswith("#") for rest in lines[number:]
            )
            if ends:
                continue  # so a document of YAML may end
            hint = "dots stand for what a listing leaves out: write it, or leave the line out"
            story = f"`{found[group]}` is not part of a configuration"
        elif found := _ARRAY.search(line):
            group, hint = 0, "write its numbers: [1.0, 2.0, 3.0]"
            story = "this is what NumPy prints of an array, not a list of YAML"
        else:
            continue
        start, end = found.span(group)
        yield problem(Span(source.name, number, start + 1, number, end + 1), story, hint, "K930")


def _kind(nodes: list[yaml.Node]) -> tuple[str, str] | None:
    """What a file is, and what it is good for."""
    if not nodes:
        return None
    node = nodes[0]
    fields = _fields(node)
    devices = fields.get("devices")
    if "world_name" in fields or any(map(_is_placed, (node, devices))):
        return (
            "this is a scene, which says where robots begin, and no configuration of a run",
            "koord sim PROGRAM CONFIGURATION --scene FILE begins there",
        )
    if isinstance(node, yaml.MappingNode) and node.value:
        if all(name.tag == _TIMESTAMP for name, _ in node.value):
            return (
                "these are results of experiments, by the time they were made, and no "
                "configuration of a run",
                "a configuration has fields such as `agents:` and `devices:`",
            )
        texts = [one.value for one in fields.values() if isinstance(one, yaml.ScalarNode)]
        if texts and all(_RULE.match(text) for text in texts):
            return (
                "this is a schema, which says what configurations look like, and no configuration",
                "`koord schema` prints the one of koord's configurations",
            )
        if len(_CI & fields.keys()) >= 2:
            return (
                "this says what a service of continuous integration does, and is no configuration "
                "of a run",
                "a configuration has fields such as `agents:` and `devices:`",
            )
    return None


def _fields(node: yaml.Node | None) -> dict[str, yaml.Node]:
    if not isinstance(node, yaml.MappingNode):
        return {}
    return {name.value: value for name, value in node.value if isinstance(name.value, str)}


def _is_placed(node: yaml.Node | None) -> bool:
    """Return whether this is a list of robots with places, as scenes have it."""
    if not isinstance(node, yaml.SequenceNode):
        return False
    return any("init_pos" in _fields(entry) for entry in node.value)
