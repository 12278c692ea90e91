"""Procedural furniture models. A new model is one new file in `classes/` (or anywhere: load("path/to/my_stool.py")).

A model file is code that runs, with all the rights of whoever runs it. It defines
    SPACE             a ParamSpace
    build(params)     a list of Parts, standing on z = 0, facing -Y, in any unit
and may define
    live_object(params, material)   a Blender object whose modifier builds the same mesh, its inputs the parameters
    turned_round(params)            if these values look like an object seen from behind, the values of about the same
                                    shape facing the other way; else None
    USUAL_DEPTH                     median and spread of log(depth / width) of real ones: what decides when a single
                                    picture leaves the depth open
"""

from procmodels.model import Model
from procmodels.model_file import ModelError
from procmodels.registry import load, names, paper_names

__all__ = ["Model", "ModelError", "load", "names", "paper_names"]
