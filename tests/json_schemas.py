"""JSON Schemas as validators find them: by the location of their files."""

import json
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import url2pathname

from jsonschema import Draft202012Validator
from referencing import Registry, Resource


def schema_at(path: Path) -> Draft202012Validator:
    """The validator of a schema, whose references are files beside it."""
    registry: Registry[Any] = Registry(retrieve=_file)
    return Draft202012Validator({"$ref": path.resolve().as_uri()}, registry=registry)


def _file(uri: str) -> Resource[Any]:
    return Resource.from_contents(json.loads(Path(url2pathname(urlsplit(uri).path)).read_text(encoding="utf-8")))
