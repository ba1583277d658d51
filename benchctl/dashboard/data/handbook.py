"""The handbook as sections of nodes, from which the page makes elements without parsing markup.

A node is a text, or a list: tag, attributes, nodes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree as ET

from markdown_it import MarkdownIt

from benchctl.app.handbook import anchor_of, title_of

_MARKDOWN = MarkdownIt("commonmark", {"html": False, "xhtmlOut": True}).enable("table")
_PAGE_LINK = re.compile(r"(?:(\w+)\.md)?(?:#([\w-]+))?")


def handbook_json(pages: Mapping[str, str]) -> dict[str, Any]:
    """Return pages, Markdown by topic, as in the interface's description."""
    return {
        "pages": [
            {"topic": topic, "title": title_of(page), "sections": _sections(topic, page, pages)}
            for topic, page in pages.items()
        ]
    }


def _sections(topic: str, page: str, pages: Mapping[str, str]) -> list[dict[str, Any]]:
    """Split a page at its headings; the first one is its title."""
    # S314: the text is ours, and what is parsed is the output of the renderer
    body = ET.fromstring(f"<body>{_MARKDOWN.render(page)}</body>")  # noqa: S314
    for one in body.iter("a"):
        _lead(one, topic, pages)
    found: list[dict[str, Any]] = []
    for block in body:
        text = "".join(block.itertext()).strip()
        if re.fullmatch("h[1-6]", block.tag):
            found.append({"anchor": anchor_of(text), "level": int(block.tag[1]), "heading": text, "content": []})
        elif text:  # a paragraph of a picture only has none
            found[-1]["content"].append(_node(block))
    return found


def _lead(one: ET.Element, topic: str, pages: Mapping[str, str]) -> None:
    """Let a link lead to a view of the page; a link to a file that is not in the handbook becomes plain text."""
    target = one.attrib.pop("href")
    there = _PAGE_LINK.fullmatch(target)
    if there and (there[1] or topic) in pages:
        one.set("href", "/".join(filter(None, ("#/help", there[1] or topic, there[2]))))
    elif "://" in target:
        one.set("href", target)
    else:
        one.tag = "span"


def _node(element: ET.Element) -> list[Any]:
    """Return an element as a node. Pictures are left out: they are not installed with the package."""
    nodes: list[Any] = [element.text or ""]
    for child in element:
        nodes += [*([] if child.tag == "img" else [_node(child)]), child.tail or ""]
    href = element.get("href")
    return [element.tag, {"href": href} if href else {}, *(one for one in nodes if one)]
