"""Every message of the program, read from its own source; `python -m tests.messages` lists them, as one text to read.

A message is what an error is made with, or what is said beside errors: problems that are found, events of a journal,
warnings, lines on stderr. `{…}` stands for what is filled in while the program runs; `{this | that}` for words that are
put together elsewhere in the same file.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("benchctl", "instruments", "procedures")
FILLED_IN = "{…}"

_ERRORS = ("Error", "Exception", "Refusal", "_unreadable", "_explained", "_refusal")
"""How the names of what makes an error end."""
_SAID_BY = ("Problem", "Flag", "event", "_event", "note", "_note", "notify", "remark")
_DEEPEST = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Message:
    """What is said, by what it is said (the class of an error, or what is called), and where."""

    path: str
    line: int
    by: str
    text: str

    @property
    def is_error(self) -> bool:
        """Whether it ends something; anything else is said beside."""
        return self.by.endswith(_ERRORS)

    @property
    def is_stated(self) -> bool:
        """Whether the words stand in the file in which it is said."""
        return any(character.isalpha() for character in self.text)


def messages() -> Iterator[Message]:
    """All messages, file by file."""
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            reader = _Reader(path.relative_to(ROOT).as_posix(), tree)
            reader.visit(tree)
            yield from reader.found


class _Reader(ast.NodeVisitor):
    """One file; `_scopes` are the names of the module, and of each function that is being read, with what they mean."""

    def __init__(self, path: str, tree: ast.Module) -> None:
        self.found: list[Message] = []
        self._path = path
        self._scopes = [_assigned(tree.body)]
        self._returned = {
            node.name: [each.value for each in ast.walk(node) if isinstance(each, ast.Return) and each.value]
            for node in ast.walk(tree)
            if isinstance(node, ast.FunctionDef)
        }

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        self._scopes.append(_assigned(ast.walk(node)))
        self.generic_visit(node)
        self._scopes.pop()

    def visit_Call(self, node: ast.Call) -> None:
        self.generic_visit(node)
        by = _name(node.func)
        given = [*(keyword.value for keyword in node.keywords if keyword.arg == "says"), *node.args]
        if given and _says_something(node, by):
            texts = [self._words(argument) for argument in given]
            text = next((text for text in texts if any(map(str.isalpha, text))), FILLED_IN)
            self.found.append(Message(path=self._path, line=node.lineno, by=by, text=text))

    def _words(self, node: ast.expr, depth: int = 0) -> str:
        match node:
            case ast.Constant(value=str(text)):
                return text
            case ast.JoinedStr(values=parts):
                return "".join(self._part(part, depth) for part in parts)
            case ast.BinOp(op=ast.Add(), left=left, right=right):
                return self._words(left, depth) + self._words(right, depth)
            case ast.IfExp(body=body, orelse=other):
                return _any_of([self._words(body, depth), self._words(other, depth)])
            case ast.BoolOp(op=ast.Or(), values=values):
                return _any_of([self._words(value, depth) for value in values])
            case ast.Call(func=ast.Attribute(value=ast.JoinedStr() as text, attr="replace")):
                return self._words(text, depth)
            case ast.Name() | ast.Call() if depth < _DEEPEST:
                return _any_of([self._words(meant, depth + 1) for meant in self._meant(node)])
            case _:
                return FILLED_IN

    def _part(self, part: ast.expr, depth: int) -> str:
        if not isinstance(part, ast.FormattedValue):
            return self._words(part, depth)
        words = self._words(part.value, depth)
        return f"{{{words}}}" if any(map(str.isalpha, words)) else FILLED_IN

    def _meant(self, node: ast.Name | ast.Call) -> list[ast.expr]:
        if isinstance(node, ast.Call):
            return self._returned.get(_name(node.func), [])
        return next((scope[node.id] for scope in reversed(self._scopes) if node.id in scope), [])


def _says_something(call: ast.Call, by: str) -> bool:
    on_stderr = by in ("tell", "echo") and any(keyword.arg == "err" for keyword in call.keywords)
    return by.endswith(_ERRORS) or by in _SAID_BY or on_stderr


def _assigned(nodes: list[ast.stmt] | Iterator[ast.AST]) -> dict[str, list[ast.expr]]:
    found: dict[str, list[ast.expr]] = {}
    for node in nodes:
        match node:
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                found.setdefault(name, []).append(value)
            case ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value):
                found.setdefault(name, []).append(value)
            case ast.NamedExpr(target=ast.Name(id=name), value=value):
                found.setdefault(name, []).append(value)
            case _:
                pass
    return found


def _name(node: ast.expr) -> str:
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name
        case _:
            return ""


def _any_of(texts: list[str]) -> str:
    different = list(dict.fromkeys(text for text in texts if text != FILLED_IN))
    return " | ".join(different) or FILLED_IN


if __name__ == "__main__":
    for message in messages():
        print(f"{message.path}:{message.line}\t{message.by}\t{message.text}")  # noqa: T201
