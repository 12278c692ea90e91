"""A device that is not the CPU, made of CPU tensors with a mark: what mixes the two fails here as it would on a GPU."""

from __future__ import annotations

import torch
from torch.overrides import TorchFunctionMode
from torch.utils._pytree import tree_flatten

PLACE = torch.device("privateuseone", 0)  # a name that torch keeps free


def is_away(tensor):
    return getattr(tensor, "_away", False)


def send(tensor):
    """The tensor, marked."""
    tensor._away = True
    return tensor


class Elsewhere(TorchFunctionMode):
    """While it lasts, `.to(PLACE)` marks tensors, marks spread to results, and `.cpu()` or `.to("cpu")` end them."""

    def __torch_function__(self, function, types, args=(), kwargs=None):
        kwargs = kwargs or {}
        tensors = [t for t in tree_flatten((args, kwargs))[0] if isinstance(t, torch.Tensor)]
        away = any(map(is_away, tensors))
        name = getattr(function, "__name__", "")
        if name == "__get__" and function == torch.Tensor.device.__get__:
            return PLACE if away else function(*args, **kwargs)
        if name in ("to", "cpu"):
            return _moved(function, args, kwargs, away)
        assert name != "numpy" or not away, "a tensor elsewhere has no numpy array"
        mixed = [t for t in tensors if not is_away(t) and t.dim()]
        indexing = name in ("__getitem__", "__setitem__")  # an index may lie on the CPU
        assert not (away and mixed) or indexing, f"{name}: tensors on the CPU and elsewhere meet"
        made = kwargs.get("device") == PLACE
        out = function(*args, **({**kwargs, "device": "cpu"} if made else kwargs))
        if away or made:
            for tensor in tree_flatten(out)[0]:
                if isinstance(tensor, torch.Tensor):
                    send(tensor)
        return out


def _moved(function, args, kwargs, away):
    """`.to` and `.cpu`: like torch, a new tensor unless nothing changes."""
    where = [a for a in (*args[1:], *kwargs.values()) if isinstance(a, torch.device | str)]
    given = torch.device(where[0]) if where else torch.device("cpu") if function is torch.Tensor.cpu else None
    args = tuple(torch.device("cpu") if a == PLACE else a for a in args)
    kwargs = {k: torch.device("cpu") if v == PLACE else v for k, v in kwargs.items()}
    out = function(*args, **kwargs)
    stays = away if given is None else given == PLACE
    if out is args[0] and stays != away:
        out = out.view_as(out)  # another tensor object, through which gradients flow
    if stays:
        return send(out)
    out._away = False
    return out
