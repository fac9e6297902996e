"""The result of linear visualization: elements cut into simplices, with linear interpolation on them."""
