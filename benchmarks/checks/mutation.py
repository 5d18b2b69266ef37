"""Small errors that can be planted in a Python file: one changed operator, constant, argument or statement each.

Docstrings, type annotations, decorators, imports, strings (messages and labels), `raise` statements and named constants
at the top of a file, which are choices rather than formulas, are never changed.
"""

import ast
import hashlib
from collections.abc import Iterator
from typing import NamedTuple

_COMPARISONS = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
_ARITHMETIC = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
_OTHER_NAME = {
    a: b
    for pair in (
        ("min", "max"),
        ("minimum", "maximum"),
        ("argmin", "argmax"),
        ("nanmin", "nanmax"),
        ("any", "all"),
        ("floor", "ceil"),
        ("mean", "sum"),
        ("zeros", "ones"),
        ("left", "right"),
    )
    for a, b in (pair, pair[::-1])
}
_BUILT_IN = {"min", "max", "any", "all"}
_ORDERLESS = {"isinstance", "min", "max", "minimum", "maximum", "logaddexp", "isclose", "array_equal", "zip"}
_OPTIONAL = {"axis", "keepdims", "ddof", "minlength", "initial", "default", "replace", "key", "reverse"}
_LOOSE = (ast.BinOp, ast.BoolOp, ast.Compare, ast.UnaryOp, ast.IfExp)
_SKIPPED = (ast.Raise, ast.Import, ast.ImportFrom, ast.JoinedStr, ast.Global, ast.Nonlocal, ast.TypeAlias)


class Mutant(NamedTuple):
    """One planted error.

    Attributes:
        module: Path of the file, relative to the repository.
        scope: Name of the function or class that holds it.
        kind: What was changed.
        line: Line in the file as it is.
        start: Byte at which the replaced text starts.
        end: Byte behind it.
        old: The replaced text.
        new: What replaces it.
        key: Names the error; does not depend on what stands elsewhere in the file.
    """

    module: str
    scope: str
    kind: str
    line: int
    start: int
    end: int
    old: str
    new: str
    key: str

    def planted(self, source: str) -> str:
        """The file with the error."""
        raw = source.encode()
        return (raw[: self.start] + self.new.encode() + raw[self.end :]).decode()


def mutants(module: str, source: str) -> Iterator[Mutant]:
    """All errors that can be planted in a file.

    Args:
        module: Its path.
        source: Its text.
    """
    starts = [0]
    for line in source.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    seen: dict[str, int] = {}
    for scope, kind, node, new in _changes(ast.parse(source), ""):
        first, last = starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset
        old = source.encode()[first:last].decode()
        name = "\0".join((module, scope, kind, old, new))
        seen[name] = seen.get(name, -1) + 1
        key = hashlib.sha256(f"{name}\0{seen[name]}".encode()).hexdigest()[:12]
        yield Mutant(module, scope, kind, node.lineno, first, last, old, new, key)


def _changes(node: ast.AST, scope: str) -> Iterator[tuple[str, str, ast.AST, str]]:
    """(scope, kind, node to replace, new text), outermost first."""
    if isinstance(node, _SKIPPED):
        return
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        scope = f"{scope}.{node.name}".lstrip(".")
    for kind, old, new in _at(node):
        # What takes the place of something that needed no parentheses may need them.
        text = new if isinstance(new, str) else f"({ast.unparse(new)})" if isinstance(new, _LOOSE) else ast.unparse(new)
        yield scope, kind, old, text
    for child in _children(node, top=not scope):
        yield from _changes(child, scope)


def _children(node: ast.AST, *, top: bool) -> Iterator[ast.AST]:
    if isinstance(node, ast.keyword) and node.arg == "strict":
        return
    for field, value in ast.iter_fields(node):
        if field in {"annotation", "returns", "decorator_list", "type_params", "bases", "format_spec"}:
            continue
        if top and field == "value" and isinstance(node, ast.Assign | ast.AnnAssign) and _is_choice(node):
            continue
        values = value if isinstance(value, list) else [value]
        if field == "args" and isinstance(node, ast.Call) and _name(node.func) == "isinstance":
            values = values[:1]
        yield from (child for child in values if isinstance(child, ast.AST))


def _is_choice(node: ast.Assign | ast.AnnAssign) -> bool:
    target = node.targets[0] if isinstance(node, ast.Assign) else node.target
    return isinstance(target, ast.Name) and target.id.isupper()


def _at(node: ast.AST) -> Iterator[tuple[str, ast.AST, ast.AST | str]]:  # noqa: PLR0912 - a line for each kind
    """What can be changed at a node: kind, node to replace, replacement."""
    match node:
        case ast.Compare():
            for i, op in enumerate(node.ops):
                ops = [_COMPARISONS[type(op)]() if i == k else other for k, other in enumerate(node.ops)]
                yield "comparison", node, ast.Compare(node.left, ops, node.comparators)
        case ast.BinOp() if type(node.op) in _ARITHMETIC and not (_is_text(node.left) or _is_text(node.right)):
            yield "arithmetic", node, ast.BinOp(node.left, _ARITHMETIC[type(node.op)](), node.right)
        case ast.AugAssign() if type(node.op) in _ARITHMETIC and not _is_text(node.value):
            yield "arithmetic", node, ast.AugAssign(node.target, _ARITHMETIC[type(node.op)](), node.value)
            yield "deleted statement", node, "pass"
        case ast.UnaryOp(op=ast.Not() | ast.USub() | ast.Invert()):
            yield "removed sign or not", node, node.operand
        case ast.BoolOp():
            yield "and/or", node, ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
        case ast.Constant(value=bool(value)):
            yield "True/False", node, str(not value)
        case ast.Constant(value=int(value)):
            yield from (("constant", node, str(other)) for other in (value + 1, value - 1) if other >= 0)
        case ast.Constant(value=float(value)):
            yield "constant", node, repr(2 * value if value else 1.0)
        case ast.Constant(value="left" | "right" as side):
            yield "left/right", node, repr(_OTHER_NAME[side])
        case ast.Name(ctx=ast.Load(), id=name) if name in _BUILT_IN:
            yield "other function", node, _OTHER_NAME[name]
        case ast.Attribute(ctx=ast.Load(), attr=name) if name in _OTHER_NAME:
            yield "other function", node, ast.Attribute(node.value, _OTHER_NAME[name])
        case ast.Call():
            yield from _call(node)
        case ast.Expr(value=ast.Call()) | ast.Break() | ast.Continue():
            yield "deleted statement", node, "pass"
        case ast.Assign(targets=[ast.Attribute() | ast.Subscript()]):
            yield "deleted statement", node, "pass"
    if isinstance(node, ast.IfExp):
        yield "swapped branches", node, ast.IfExp(node.test, node.orelse, node.body)
    elif isinstance(node, ast.If | ast.While) and isinstance(node.test, ast.Name | ast.Attribute | ast.Call):
        yield "negated condition", node.test, ast.UnaryOp(ast.Not(), node.test)


def _call(node: ast.Call) -> Iterator[tuple[str, ast.AST, ast.AST]]:
    two = [a for a in node.args[:2] if not isinstance(a, ast.Starred | ast.Constant | ast.GeneratorExp | ast.Lambda)]
    if len(two) == 2 and _name(node.func) not in _ORDERLESS and ast.dump(two[0]) != ast.dump(two[1]):
        yield "swapped arguments", node, ast.Call(node.func, [two[1], two[0], *node.args[2:]], node.keywords)
    for keyword in node.keywords:
        if keyword.arg in _OPTIONAL:
            rest = [other for other in node.keywords if other is not keyword]
            yield "left out argument", node, ast.Call(node.func, node.args, rest)


def _name(function: ast.AST) -> str:
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))
