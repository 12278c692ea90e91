"""Trained networks, one `<class>.safetensors` a class, each with its card `<class>.json`."""
