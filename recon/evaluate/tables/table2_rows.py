"""What Table 2 measures of one object from one kind of input."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field

from procmodels.space import Params


@dataclass(frozen=True)
class Table2Row:
    """One object and one input.

    d_chamfer  in the object's canonical frame; one mask with an unknown camera: after the best quarter turn
    oracle     the best that is known of the model on this object; the same in all rows of an object
    turn       quarter turns by which the front is wrong; 0 is right, also where the object looks the same
    iou        of the outlines, None for meshes and points
    seconds    of processor time, without reading the file
    error      why there is no answer, empty otherwise; d_chamfer is None then
    """

    data: str
    class_name: str
    input: str
    object: str
    oracle: float
    d_chamfer: float | None = None
    turn: int | None = None
    iou: float | None = None
    seconds: float | None = None
    params: Params = field(default_factory=dict)
    error: str = ""

    @staticmethod
    def from_json(values: dict) -> Table2Row:
        """The inverse of as_json."""
        rest = {k: v for k, v in values.items() if k != "class"}
        return Table2Row(class_name=values["class"], **rest)

    def as_json(self) -> dict:
        """The row as written to files: `class` for class_name."""
        values = asdict(self)
        first = ("data", "class", "input", "object", "d_chamfer")
        values["class"] = values.pop("class_name")
        return {k: values.pop(k) for k in first} | values
