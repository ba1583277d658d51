"""The handbook as nodes: what Markdown becomes, where links lead, and what is left out."""

from __future__ import annotations

from typing import Any

from benchctl.dashboard.data.handbook import handbook_json
from benchctl.explain.glossary_page import glossary_page

_ONE = """# One

Words, `code` & <b>no markup</b>. ![a picture](one.png)

![only a picture](two.png)

## A heading, with a comma

[there](two.md#part) [here](#a-heading-with-a-comma) [a file](../../README.md) [elsewhere](https://example.org/)

| a | b |
|---|---:|
| 1 | 2 |
"""


def sections(**pages: str) -> list[dict[str, Any]]:
    """The sections of the first page."""
    found: list[dict[str, Any]] = handbook_json(pages)["pages"][0]["sections"]
    return found


def test_a_page_is_cut_at_its_headings_and_keeps_no_markup_and_no_pictures() -> None:
    first, second = sections(one=_ONE)
    assert (first["anchor"], first["level"], first["heading"]) == ("one", 1, "One")
    assert first["content"] == [["p", {}, "Words, ", ["code", {}, "code"], " & <b>no markup</b>. "]]
    assert (second["anchor"], second["level"]) == ("a-heading-with-a-comma", 2)


def test_links_lead_to_views_and_those_to_files_that_are_not_installed_are_text() -> None:
    paragraph = sections(one=_ONE, two="# Two")[1]["content"][0]
    assert [node for node in paragraph[2:] if node != " "] == [
        ["a", {"href": "#/help/two/part"}, "there"],
        ["a", {"href": "#/help/one/a-heading-with-a-comma"}, "here"],
        ["span", {}, "a file"],
        ["a", {"href": "https://example.org/"}, "elsewhere"],
    ]


def test_no_node_has_a_style_which_the_policy_of_the_page_forbids() -> None:
    table = sections(one=_ONE)[1]["content"][1]
    assert table[0] == "table"
    assert "style" not in str(table)


def test_every_link_of_the_glossary_leads_to_a_term() -> None:
    found = sections(terms=glossary_page())
    anchors = {section["anchor"] for section in found}
    links = [
        node[1]["href"] for section in found for block in section["content"] for node in block[2:] if node[0] == "a"
    ]
    assert len(links) > 200
    assert [one for one in links if one.removeprefix("#/help/terms/") not in anchors] == []
