"""Small changes of a Python source, one at a time: comparisons, arithmetic, constants, logic, returns, statements.

Only what can change behaviour: no annotations, texts, imports, decorators, log lines, nor what an error says.
Of our own because mutmut and cosmic-ray run whole trees in place; here a seeded sample is drawn over some packages and
each mutant meets its room's tests in a copy.
"""

from __future__ import annotations

import ast
import copy
from collections.abc import Iterator
from dataclasses import dataclass

_OPERATORS: dict[type[ast.AST], tuple[type[ast.AST], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.LtE), ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,), ast.NotIn: (ast.In,), ast.And: (ast.Or,), ast.Or: (ast.And,),
    ast.Add: (ast.Sub,), ast.Sub: (ast.Add,), ast.Mult: (ast.Div,), ast.Div: (ast.Mult,), ast.Pow: (ast.Mult,),
    ast.FloorDiv: (ast.Div,), ast.Mod: (ast.Mult,), ast.BitAnd: (ast.BitOr,), ast.BitOr: (ast.BitAnd,),
    ast.LShift: (ast.RShift,), ast.RShift: (ast.LShift,),
}  # fmt: skip
_REMOVED = (ast.Expr, ast.Assign, ast.AugAssign, ast.Raise, ast.Break, ast.Continue, ast.Delete)
_LEFT_ALONE = (ast.JoinedStr, ast.Import, ast.ImportFrom, ast.TypeAlias) if hasattr(ast, "TypeAlias") else (
    ast.JoinedStr, ast.Import, ast.ImportFrom,
)  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One change: the text from `start` to `end` becomes `after`. `where` is the function or class it is in."""

    kind: str
    where: str
    line: int
    start: int
    end: int
    before: str
    after: str

    def apply(self, source: str) -> str:
        """The source with this change."""
        return source[: self.start] + self.after + source[self.end :]


def mutants(source: str) -> list[Mutant]:
    """All mutants of a source, in order of place. A few may not compile."""
    return list(_Finder(source).find())


def compiles(source: str) -> bool:
    """Whether a spoilt source is Python still."""
    try:
        compile(source, "mutant", "exec")
    except (SyntaxError, ValueError):
        return False
    return True


class _Finder:
    def __init__(self, source: str) -> None:
        self._source = source
        self._lines = [0]
        for line in source.splitlines(keepends=True):
            self._lines.append(self._lines[-1] + len(line))
        self._texts = source.splitlines(keepends=True)

    def find(self) -> Iterator[Mutant]:
        yield from self._of_body(ast.parse(self._source), "")

    def _of_body(self, node: ast.AST, where: str) -> Iterator[Mutant]:
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            where = f"{where}.{node.name}".lstrip(".")
        yield from self._of_node(node, where)
        for child in _children(node):
            yield from self._of_body(child, where)

    def _of_node(self, node: ast.AST, where: str) -> Iterator[Mutant]:
        if isinstance(node, ast.expr):
            for kind, changed in _expressions(node):
                yield self._mutant(kind, where, node, f"({ast.unparse(changed)})")
        elif isinstance(node, ast.AugAssign) and type(node.op) in _OPERATORS:
            for other in _OPERATORS[type(node.op)]:
                changed = copy.copy(node)
                changed.op = other()  # type: ignore[assignment]
                yield self._mutant("arithmetic", where, node, ast.unparse(changed))
        elif isinstance(node, ast.Return) and node.value is not None and not _is_none(node.value):
            yield self._mutant("return", where, node, "return None")
        if isinstance(node, _REMOVED) and where and not _is_text(node) and not _is_log(node):
            yield self._mutant("statement", where, node, "pass")

    def _mutant(self, kind: str, where: str, node: ast.expr | ast.stmt, after: str) -> Mutant:
        start, end = self._at(node.lineno, node.col_offset), self._at(node.end_lineno or 0, node.end_col_offset or 0)
        return Mutant(kind, where, node.lineno, start, end, self._source[start:end], after)

    def _at(self, line: int, column: int) -> int:
        """Place in the text of a line and a column in bytes of UTF-8."""
        return self._lines[line - 1] + len(self._texts[line - 1].encode()[:column].decode())


def _children(node: ast.AST) -> Iterator[ast.AST]:
    skipped: list[ast.AST | None] = []
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        skipped = [*node.decorator_list, node.returns]
    elif isinstance(node, ast.ClassDef):
        skipped = [*node.decorator_list, *node.bases, *node.keywords]
    elif isinstance(node, ast.arg | ast.AnnAssign):
        skipped = [node.annotation]
    elif isinstance(node, ast.Raise):
        skipped = [node.exc, node.cause]
    elif isinstance(node, ast.Assert):
        skipped = [node.msg]
    elif isinstance(node, ast.Assign) and any(isinstance(t, ast.Name) and t.id == "__all__" for t in node.targets):
        return
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, _LEFT_ALONE) and not any(child is one for one in skipped) and not _is_log(child):
            yield child


def _expressions(node: ast.expr) -> Iterator[tuple[str, ast.expr]]:
    if isinstance(node, ast.Compare):
        for i, operator in enumerate(node.ops):
            for other in _OPERATORS.get(type(operator), ()):
                changed = copy.copy(node)
                changed.ops = [*node.ops[:i], other(), *node.ops[i + 1 :]]  # type: ignore[list-item]
                yield "comparison", changed
    elif isinstance(node, ast.BinOp | ast.BoolOp):
        for other in _OPERATORS.get(type(node.op), ()):
            changed = copy.copy(node)
            changed.op = other()  # type: ignore[assignment]
            yield "arithmetic" if isinstance(node, ast.BinOp) else "boolean", changed
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        yield "boolean" if isinstance(node.op, ast.Not) else "arithmetic", node.operand
    elif isinstance(node, ast.Constant) and type(node.value) in (bool, int, float):
        value = node.value
        other = (
            (not value) if isinstance(value, bool) else value + 1 if isinstance(value, int) else (2.0 * value or 1.0)
        )
        yield "constant", ast.Constant(other)


def _is_none(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _is_log(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Call)
        and ast.unparse(node.value.func).startswith(("_log.", "logging."))
    )
