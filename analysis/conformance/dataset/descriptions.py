"""Descriptions of the kit for catalogues of data: RO-Crate 1.1 and Croissant 1.0, both JSON-LD.

Facts from https://w3id.org/ro/crate/1.1 and http://mlcommons.org/croissant/1.0.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from .checksums import sha256
from .version import KIT_VERSION, RELEASED, provenance

CRATE, CROISSANT = "ro-crate-metadata.json", "croissant.json"
_CC0 = "https://creativecommons.org/publicdomain/zero/1.0/"
_NAME = "solidtouch conformance kit"
_ABOUT = (
    "Cases with exact answers for programs that do active Bayesian perception of object and position from touch, "
    "after Lepora, Martinez-Hernandez and Prescott (2013): models, taps and moves as plain numbers, and likelihoods, "
    "beliefs, decisions and moves that are right, computed in 60-digit arithmetic."
)
_KEYWORDS = ["tactile sensing", "active perception", "Bayesian filtering", "conformance test"]
_CREATOR = "The solidtouch developers"
_CITATION = (
    f"@misc{{solidtouch_kit, title = {{{_NAME}}}, author = {{{{{_CREATOR}}}}}, "
    f"version = {{{KIT_VERSION}}}, year = {{{RELEASED[:4]}}}}}"
)
_MEDIA_TYPES = {
    ".json": "application/json",
    ".jsonl": "application/jsonl",
    ".npz": "application/zip",
    ".md": "text/markdown",
    "": "text/plain",
}


class KitFile(NamedTuple):
    """A file of the kit.

    Attributes:
        path: Where it is.
        about: What it holds.
    """

    path: Path
    about: str

    @property
    def media_type(self) -> str:
        """As MIME has it."""
        return _MEDIA_TYPES[self.path.suffix]


def ro_crate(files: Sequence[KitFile]) -> dict[str, Any]:
    """The metadata of an RO-Crate."""
    made = provenance()
    programs = [
        _program("#solidtouch", "solidtouch", made["program_version"]),
        _program("#mpmath", "mpmath", made["library_version"]),
    ]
    action = {
        "@id": "#exact-answers",
        "@type": "CreateAction",
        "name": "Computation of the exact answers",
        "description": f"{made['method']}; {made['digits']} decimal digits",
        "instrument": [_reference(program["@id"]) for program in programs],
        "result": _reference("./"),
    }
    root = {
        "@id": "./",
        "@type": "Dataset",
        "name": f"{_NAME} {KIT_VERSION}",
        "description": _ABOUT,
        "datePublished": RELEASED,
        "version": KIT_VERSION,
        "keywords": _KEYWORDS,
        "license": _reference(_CC0),
        "author": _reference("#developers"),
        "publisher": _reference("#developers"),
        "mentions": _reference("#exact-answers"),
        "hasPart": [_reference(file.path.name) for file in files],
    }
    descriptor = {
        "@id": CRATE,
        "@type": "CreativeWork",
        "conformsTo": _reference("https://w3id.org/ro/crate/1.1"),
        "about": _reference("./"),
    }
    licence = {
        "@id": _CC0,
        "@type": "CreativeWork",
        "name": "CC0 1.0 Universal",
        "description": "Public domain dedication: no rights reserved.",
    }
    developers = {"@id": "#developers", "@type": "Organization", "name": _CREATOR}
    parts = [
        {
            "@id": file.path.name,
            "@type": "File",
            "name": file.path.name,
            "description": file.about,
            "encodingFormat": file.media_type,
            "contentSize": str(file.path.stat().st_size),
        }
        for file in files
    ]
    graph = [descriptor, root, licence, developers, *programs, action, *parts]
    return {"@context": "https://w3id.org/ro/crate/1.1/context", "@graph": graph}


def _program(identifier: str, name: str, version: str) -> dict[str, Any]:
    return {
        "@id": identifier,
        "@type": "SoftwareApplication",
        "name": name,
        "softwareVersion": version,
    }


def croissant(files: Sequence[KitFile]) -> dict[str, Any]:
    """The metadata of Croissant; addresses of files are relative to it."""
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": _NAME.replace(" ", "-"),
        "description": _ABOUT,
        "version": KIT_VERSION,
        "datePublished": RELEASED,
        "license": _CC0,
        "url": "./",
        "keywords": _KEYWORDS,
        "creator": {"@type": "sc:Organization", "name": _CREATOR},
        "citeAs": _CITATION,
        "isLiveDataset": False,
        "distribution": [
            {
                "@type": "cr:FileObject",
                "@id": file.path.name,
                "name": file.path.name,
                "description": file.about,
                "contentUrl": file.path.name,
                "contentSize": f"{file.path.stat().st_size} B",
                "encodingFormat": file.media_type,
                "sha256": sha256(file.path),
            }
            for file in files
        ],
        "recordSet": [
            {
                "@type": "cr:RecordSet",
                "@id": "cases",
                "name": "cases",
                "description": "The cases, a record for each.",
                "key": _reference("cases/case"),
                "field": [_field(*field) for field in _FIELDS],
            }
        ],
    }


_FIELDS = (
    ("case", "Name of the case; NAME.json holds it with its answers, NAME.jsonl what a program reads.", "sc:Text"),
    ("level", "What a program that passes all cases of it can claim.", "sc:Text"),
    ("about", "What the case tests.", "sc:Text"),
    ("taps", "Number of taps.", "sc:Integer"),
)


def _field(name: str, about: str, kind: str) -> dict[str, Any]:
    return {
        "@type": "cr:Field",
        "@id": f"cases/{name}",
        "name": name,
        "description": about,
        "dataType": kind,
        "source": {"fileObject": _reference("index.json"), "extract": {"jsonPath": f"$.cases[*].{name}"}},
    }


def _reference(identifier: str) -> dict[str, str]:
    return {"@id": identifier}


_OWN_TERMS = [
    "column",
    "equivalentProperty",
    "extract",
    "field",
    "fileObject",
    "fileProperty",
    "fileSet",
    "format",
    "includes",
    "isLiveDataset",
    "jsonPath",
    "key",
    "md5",
    "parentField",
    "path",
    "recordSet",
    "references",
    "regex",
    "repeated",
    "replace",
    "samplingRate",
    "separator",
    "source",
    "subField",
    "transform",
    "citeAs",
]
_CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "dct": "http://purl.org/dc/terms/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "conformsTo": "dct:conformsTo",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    **{term: f"cr:{term}" for term in _OWN_TERMS},
}
