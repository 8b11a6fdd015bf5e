"""The command line: the only room that prints, reads ``argv``, and exits.

One file per command (:mod:`koord.cli.main` has the list), each with ``configure(parser)`` and
``main(arguments) -> int``. A command's file is imported when the command runs, not before.
"""
