"""From a scientist's file to a Grid: one module a format, one list of them (`formats`).

A reader tells what its file holds (a `Source`) before any voxel is read; `gather` then takes the
voxels slab by slab, so that memory follows what is kept and not what a header claims. Libraries
are loaded when a file needs them.
"""
