"""Remarks on a picture that the picture itself doesn't show."""

from __future__ import annotations

from collections.abc import Sequence

from elvis.core.data.conversion_errors import ConversionErrors
from elvis.core.data.dataset import Dataset
from elvis.core.quantities import Expression
from elvis.core.quantities.conversion_radius import sentence
from elvis.core.quantities.derived import RECOVERED
from elvis.core.quantities.largest_radii import largest_radii
from elvis.plugins.runtime.opening import PluginData
from elvis.plugins.runtime.serving import names_of
from elvis.renderer.frame.undeformed import WALLS
from elvis.scene import Faces, Isosurface, Scene
from elvis.scene.model.quantities import quantities
from elvis.scene.record.frame import Frame


def note(frame: Frame, scene: Scene, data: Dataset | PluginData, remarks: Sequence[str]) -> Frame:
    """The frame with the moment of its data and remarks: also that all faces stand in where nothing was requested."""
    shown = frame.scene.objects
    if not scene.every_object and len(shown) == 1 and isinstance(shown[0], Faces):
        remarks = ("no objects are given, such as --plane or --cut: all outer faces are shown", *remarks)
    frame.stats["remarks"] = [*remarks, *frame.stats.get("remarks", ()), *_constants(frame)]
    if isinstance(data, Dataset) and data.deformation is not None:
        known = data.deformation
        told = [remark for remark in remarks if remark in known.told or remark.startswith(f"{WALLS}: ")]
        frame.stats["deformation"] = {"scale": known.scale, "folds": known.folds, "remarks": told}
    return frame.at(data.instant) if isinstance(data, Dataset) and data.instant is not None else frame


def remarks_on_derived(data: Dataset | PluginData, scene: Scene) -> list[str]:
    """Remarks on derivatives in time and on recovered fields in a scene."""
    return [*_remarks_on_rates(data, scene), *_remarks_on_recovery(data, scene)]


def _remarks_on_rates(data: Dataset | PluginData, scene: Scene) -> list[str]:
    """A remark on derivatives in time, if the scene has some."""
    if not isinstance(data, Dataset) or data.rates is None:
        return []
    names = names_of(data)
    has_some = any(Expression.parse(text, names).has_rates for text in quantities(scene))
    return [data.rates.remark] if has_some else []


def _remarks_on_recovery(data: Dataset | PluginData, scene: Scene) -> list[str]:
    """Remarks on recovered fields in the scene, with the largest difference to the data."""
    texts = [text for text in quantities(scene) if RECOVERED in text]
    if not isinstance(data, Dataset) or not texts:
        return []
    from elvis.core.resolution.recovered_remarks import remarks_on_recovered

    return remarks_on_recovered(data, [Expression.of(data, text) for text in texts])


def remarks_on_conversion(data: Dataset, scene: Scene) -> list[str]:
    """A remark on the error of the conversion in the quantities of the scene, if there is one."""
    if not ConversionErrors.of(data.metadata):
        return []
    shown = [Expression.of(data, text) for text in quantities(scene) if text]
    found = sentence([each.text for each in shown], largest_radii(data, shown).tolist())
    return [found] if found else []


def _constants(frame: Frame) -> list[str]:
    """Sentences about fields that have one value wherever they are seen; isosurfaces go without saying."""
    if any(isinstance(item, Isosurface) for item in frame.scene.every_object):
        return []
    constant = [legend for legend in frame.legends if legend.constant is not None]
    return [f"{legend.title} is {legend.constant:g} everywhere in the picture: one colour" for legend in constant]
