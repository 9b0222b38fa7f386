"""Sphinx configuration."""

project = "transferkit"
author = "the transferkit developers"
copyright = "2026, the transferkit developers"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = "transferkit"
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_mock_imports: list[str] = []
myst_heading_anchors = 3
suppress_warnings = ["ref.python"]
default_role = "code"
