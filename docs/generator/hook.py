"""By this mkdocs gets the pages that are no files of `docs/`, and links as they are in the site."""

from __future__ import annotations

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from docs.generator.site import Site, filled, in_navigation, in_project

_QUIET = "---\nsearch:\n  exclude: true\n---\n\n"


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """List the generated pages of a folder behind the one that lists them."""
    config.nav = filled(config.nav or [])
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Put the pages of the site in the place of those in the folder."""
    site = Site(in_project(in_navigation(config.nav or [])))
    for place, text in site.pages.items():
        if present := files.get_file_from_path(place):
            files.remove(present)
        content = _QUIET + text if site.search_excluded(place) else text
        files.append(File.generated(config, place, content=content))
    for place, path in site.pictures.items():
        files.append(File.generated(config, place, abs_src_path=str(path)))
    return files
