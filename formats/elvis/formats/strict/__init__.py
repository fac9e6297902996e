"""Check files against every rule that the format's own programs impose on a writer (format notes 9).

`elvis.formats.read` accepts far more than those programs do; `findings` lists the rules whose violation makes them
reject a file, and the rules that are only good practice.  A rule counts as required if their reader (version 5) stops
at a file that breaks it (format notes 9).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from os.path import isfile
from pathlib import Path

from elvis.core.base.errors import FormatError
from elvis.core.base.ranks import ALONE, Ranks
from elvis.core.data.dataset import Dataset
from elvis.core.files.plain import leading
from elvis.formats.nektar import expansions, fields_input, hdf5, xml
from elvis.formats.nektar.geometry import hdf5 as geometry_hdf5
from elvis.formats.nektar.hdf5 import HDF5_SIGNATURE
from elvis.formats.nektar.mapped_files import mapped
from elvis.formats.nektar.sections import Section
from elvis.formats.nektar.xml import Element, load
from elvis.formats.reading import read
from elvis.formats.strict.field_rules import (
    Needed,
    expansion_findings,
    needed_modes,
    repeated_sections,
    section_findings,
)
from elvis.formats.strict.finding import Finding, library_rule
from elvis.formats.strict.hdf5_rules import field_file_findings, mesh_file_findings
from elvis.formats.strict.in_parts import sound_part
from elvis.formats.strict.mesh_rules import mesh_findings
from elvis.formats.strict.xml_rules import geometry_findings, payload_findings


def findings(*paths: str | Path, ranks: Ranks = ALONE) -> tuple[Finding, ...]:
    """All rules that the files of one dataset break, in the order of the files; empty if they are all obeyed.

    Jacobians are sampled, at Gauss points; text is checked by its first numbers only.  Raises ElvisError if no file can
    be read.

    ranks  each reads its part; if something is wrong in one, the first rank reads all and the others return nothing
    """
    if ranks.size > 1:
        found = _findings_of_parts(paths, ranks)
        if ranks.rank:
            return ()
        if found is not None:
            return found
    review = _Review()
    review.files(paths)
    review.attempt(", ".join(Path(path).name for path in paths), lambda: review.whole(read(*paths)))
    return tuple(dict.fromkeys(review.found))


def _findings_of_parts(paths: Sequence[str | Path], ranks: Ranks) -> tuple[Finding, ...] | None:
    """The findings if mesh and fields are valid by themselves; None, for all ranks, if they may be invalid."""
    with mapped():
        review = _Review(stays_packed=True)
        review.files(paths)
        part = sound_part(paths, review.sections, ranks)
        if part is None:
            return None
        review.found += repeated_sections(review.sections)
        review.expansions(part.dataset, part.needed)
    return tuple(dict.fromkeys(review.found))


@dataclass(eq=False)
class _Review:
    """Collects findings, and the sections and expansion rules to be checked at the end.

    stays_packed  whether coefficients stay packed; a reader of a part then finds errors in them
    """

    stays_packed: bool = False
    found: list[Finding] = field(default_factory=list)
    sections: list[Section] = field(default_factory=list)
    tags: dict[str, Element] = field(default_factory=dict)

    def attempt(self, place: str, action: Callable[[], None]) -> None:
        """Run ``action``; an error of the format becomes a finding."""
        try:
            action()
        except FormatError as error:
            self.found.append(library_rule(place, str(error)))

    def files(self, paths: Sequence[str | Path]) -> None:
        """Check the content of each file; for a folder, check the files in it."""
        for path in map(Path, paths):
            for file in sorted(path.glob("*.*")) if path.is_dir() else [path]:
                self.attempt(file.name, lambda file=file: self.file(file))  # type: ignore[misc]

    def file(self, path: Path) -> None:
        """Check what one file holds."""
        if leading(path, len(HDF5_SIGNATURE)) == HDF5_SIGNATURE:
            self._hdf5(path)
            return
        for root in xml.parse(load(path), str(path)):
            xml.check_root(root, str(path))
            for child in root.children():
                self._child(path, child)

    def whole(self, dataset: Dataset) -> None:
        """Check what all files mean together."""
        self.found += mesh_findings(dataset)
        self.found += section_findings(dataset.mesh, self.sections)
        self.expansions(dataset, needed_modes(dataset, self.sections))

    def expansions(self, dataset: Dataset, needed: Needed) -> None:
        """Check what EXPANSIONS say of a dataset, or of a part."""
        self.attempt("<EXPANSIONS>", lambda: self.found.extend(self._expansions(dataset, needed)))

    def _expansions(self, dataset: Dataset, needed: Needed) -> Iterator[Finding]:
        element = self.tags.get("EXPANSIONS")
        rules = expansions.read_rules(element, self.tags.get("CONDITIONS"))
        entries = [] if element is None else [child.tag for child in element.children()]
        if entries and "E" not in entries:
            return  # orders by element, or from a field file
        yield from expansion_findings(dataset, expansions.resolve(rules, dataset.mesh), needed)

    def _child(self, path: Path, child: Element) -> None:
        place = f"{path.name}, {child.place}"
        if child.tag == "ELEMENTS":
            self.attempt(place, lambda: self.found.extend(payload_findings(place, child)))
            self.attempt(place, lambda: self._add_section(child))
        elif child.tag == "GEOMETRY":
            self.found += [finding.within(path.name) for finding in geometry_findings(child)]
            if "HDF5FILE" in child.attributes:
                self._stub(path, child)
        elif not child.is_empty or child.tag not in self.tags:
            self.tags[child.tag] = child

    def _add_section(self, child: Element) -> None:
        self.sections.append(fields_input.read_section(child, stays_packed=self.stays_packed))

    def _stub(self, path: Path, child: Element) -> None:
        name = child.attributes["HDF5FILE"]
        companion = path.parent / name
        if isfile(companion):
            self.attempt(companion.name, lambda: self._hdf5(companion))
        else:
            self.found.append(
                library_rule(f"{path.name}, {child.place}", f"expected the file {name} next to it, found none")
            )

    def _hdf5(self, path: Path) -> None:
        with hdf5.reading(path) as file, hdf5.format_errors():
            is_mesh = geometry_hdf5.is_geometry(file)
            found = (mesh_file_findings if is_mesh else field_file_findings)(file)
            self.found += [finding.within(path.name) for finding in found]
        if not is_mesh:
            self.sections += fields_input.read_hdf5(path)[0]
