"""Koord: programs for teams of robots, with a formal semantics that is run and verified.

    import koord

    program = koord.load("task.krd")
    report = koord.verify(program, robots=3, rounds=20)
    print(report)

Importing this package loads nothing else: each name is loaded when it is first asked for. The
floors are described in ``ARCHITECTURE.md``.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from koord.api.cache import Cache as Cache
    from koord.api.campaign import Campaign as Campaign
    from koord.api.campaign import campaign as campaign
    from koord.api.certify import Certificate as Certificate
    from koord.api.certify import certify as certify
    from koord.api.compile import CompiledProgram as CompiledProgram
    from koord.api.compile import compile as compile
    from koord.api.configurations import ConfigurationReport as ConfigurationReport
    from koord.api.configurations import check_configuration as check_configuration
    from koord.api.conform import Conformance as Conformance
    from koord.api.conform import conform as conform
    from koord.api.deployed import Deployed as Deployed
    from koord.api.deployment import deploy as deploy
    from koord.api.doctor import Doctor as Doctor
    from koord.api.doctor import doctor as doctor
    from koord.api.documents import codes as codes
    from koord.api.documents import explain as explain
    from koord.api.documents import format as format
    from koord.api.documents import schema as schema
    from koord.api.drivers import DriverEntry as DriverEntry
    from koord.api.drivers import installed_drivers as installed_drivers
    from koord.api.drivers import installed_localisers as installed_localisers
    from koord.api.drivers import installed_plug_ins as installed_plug_ins
    from koord.api.editing import Document as Document
    from koord.api.editing import document as document
    from koord.api.export import Exported as Exported
    from koord.api.export import export as export
    from koord.api.fitting import read_configuration as read_configuration
    from koord.api.guardian_check import GuardianCheck as GuardianCheck
    from koord.api.guardian_check import check_guardian as check_guardian
    from koord.api.html import html as html
    from koord.api.merge import Merged as Merged
    from koord.api.merge import merge as merge
    from koord.api.migrate import Migration as Migration
    from koord.api.migrate import migrate as migrate
    from koord.api.new import NewProject as NewProject
    from koord.api.new import new as new
    from koord.api.orders import OrderReport as OrderReport
    from koord.api.orders import estop as estop
    from koord.api.orders import heartbeat as heartbeat
    from koord.api.orders import order as order
    from koord.api.programs import CheckReport as CheckReport
    from koord.api.programs import Program as Program
    from koord.api.programs import check as check
    from koord.api.programs import load as load
    from koord.api.progress import Cancellation as Cancellation
    from koord.api.progress import CancelledError as CancelledError
    from koord.api.progress import Progress as Progress
    from koord.api.protocol_check import ProtocolCheck as ProtocolCheck
    from koord.api.protocol_check import ProtocolProof as ProtocolProof
    from koord.api.protocol_check import check_protocol as check_protocol
    from koord.api.protocol_check import prove_protocol as prove_protocol
    from koord.api.recheck import RecheckReport as RecheckReport
    from koord.api.recheck import recheck as recheck
    from koord.api.refine_simulated import SimulatedRuns as SimulatedRuns
    from koord.api.refine_simulated import refine_simulated as refine_simulated
    from koord.api.refinement import Refinement as Refinement
    from koord.api.refinement import refine as refine
    from koord.api.remote import Login as Login
    from koord.api.remote import RemoteLine as RemoteLine
    from koord.api.remote import deploy_remotely as deploy_remotely
    from koord.api.replay import ReplayReport as ReplayReport
    from koord.api.replay import load_trace as load_trace
    from koord.api.replay import replay as replay
    from koord.api.results import ArgumentError as ArgumentError
    from koord.api.run import Policy as Policy
    from koord.api.run import RunReport as RunReport
    from koord.api.run import run as run
    from koord.api.sarif import sarif as sarif
    from koord.api.session import Session as Session
    from koord.api.sim_report import Simulated as Simulated
    from koord.api.simulation import simulate as simulate
    from koord.api.splitting import Splitting as Splitting
    from koord.api.splitting import splitting as splitting
    from koord.api.stepping import Stepper as Stepper
    from koord.api.stepping import step as step
    from koord.api.stories import Story as Story
    from koord.api.stories import story as story
    from koord.api.traces import Trace as Trace
    from koord.api.verdicts import Verdict as Verdict
    from koord.api.verify import Engine as Engine
    from koord.api.verify import verify as verify
    from koord.api.verify_report import VerdictProgress as VerdictProgress
    from koord.api.verify_report import VerifyReport as VerifyReport
    from koord.syntax.diagnostics import Diagnostic as Diagnostic
    from koord.syntax.diagnostics import KoordError as KoordError
    from koord.syntax.source import Source as Source
    from koord.syntax.source import Span as Span
    from koord.version import __version__ as __version__

#: Where each public name stands.
_HOMES = {
    "koord.api.cache": ("Cache",),
    "koord.api.campaign": ("Campaign", "campaign"),
    "koord.api.certify": ("Certificate", "certify"),
    "koord.api.compile": ("CompiledProgram", "compile"),
    "koord.api.configurations": ("ConfigurationReport", "check_configuration"),
    "koord.api.conform": ("Conformance", "conform"),
    "koord.api.deployed": ("Deployed",),
    "koord.api.deployment": ("deploy",),
    "koord.api.doctor": ("Doctor", "doctor"),
    "koord.api.documents": ("codes", "explain", "format", "schema"),
    "koord.api.drivers": (
        "DriverEntry",
        "installed_drivers",
        "installed_localisers",
        "installed_plug_ins",
    ),
    "koord.api.editing": ("Document", "document"),
    "koord.api.export": ("Exported", "export"),
    "koord.api.fitting": ("read_configuration",),
    "koord.api.guardian_check": ("GuardianCheck", "check_guardian"),
    "koord.api.html": ("html",),
    "koord.api.merge": ("Merged", "merge"),
    "koord.api.migrate": ("Migration", "migrate"),
    "koord.api.new": ("NewProject", "new"),
    "koord.api.orders": ("OrderReport", "estop", "heartbeat", "order"),
    "koord.api.programs": ("CheckReport", "Program", "check", "load"),
    "koord.api.progress": ("Cancellation", "CancelledError", "Progress"),
    "koord.api.protocol_check": (
        "ProtocolCheck",
        "ProtocolProof",
        "check_protocol",
        "prove_protocol",
    ),
    "koord.api.recheck": ("RecheckReport", "recheck"),
    "koord.api.refine_simulated": ("SimulatedRuns", "refine_simulated"),
    "koord.api.refinement": ("Refinement", "refine"),
    "koord.api.remote": ("Login", "RemoteLine", "deploy_remotely"),
    "koord.api.replay": ("ReplayReport", "load_trace", "replay"),
    "koord.api.results": ("ArgumentError",),
    "koord.api.run": ("Policy", "RunReport", "run"),
    "koord.api.sarif": ("sarif",),
    "koord.api.session": ("Session",),
    "koord.api.sim_report": ("Simulated",),
    "koord.api.simulation": ("simulate",),
    "koord.api.stepping": ("Stepper", "step"),
    "koord.api.splitting": ("Splitting", "splitting"),
    "koord.api.stories": ("Story", "story"),
    "koord.api.traces": ("Trace",),
    "koord.api.verdicts": ("Verdict",),
    "koord.api.verify_report": ("VerdictProgress", "VerifyReport"),
    "koord.api.verify": ("Engine", "verify"),
    "koord.syntax.diagnostics": ("Diagnostic", "KoordError"),
    "koord.syntax.source": ("Source", "Span"),
    "koord.version": ("__version__",),
}

_HOME = {name: module for module, names in _HOMES.items() for name in names}

__all__ = tuple(_HOME)


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(_HOME[name]), name)
    if name not in _FOLDERS:
        globals()[name] = found
    return found


def load_ipython_extension(shell: object) -> None:
    """Give a notebook the magics ``%koord`` and ``%%koord``: ``%load_ext koord``."""
    import_module("koord.plugins.notebook").load(shell)


class _Package(ModuleType):
    """The package's module class: a function with the name of a sub-package stays callable.

    Imports would put the folder in its place. What stands in it is imported by its full name.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if name not in _FOLDERS:
            super().__setattr__(name, value)


#: Functions whose names folders have as well.
_FOLDERS = ("verify", "recheck")

sys.modules[__name__].__class__ = _Package


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
