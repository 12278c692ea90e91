"""How large an input may be: every limit, stated once, and checked from headers before memory is taken.

A run stays below 4 GB. Numbers without a unit count things; the comments say what a limit leaves room for.
"""

# Memory that the libraries need before anything is read; below it they fail to load, or wait for ever.
ADDRESS_SPACE = 4 << 30  # bytes, as ulimit -v counts them
DATA = 2 << 30  # bytes, as ulimit -d counts them

# Pictures: photos, masks, textures
PIXELS = 200_000_000  # of one; the largest phone sensors have these, and PIL takes 4 bytes for each
PIXELS_AT_ONCE = 50_000_000  # pictures above it are decoded one after the other
PICTURE_SIDE = 65_535  # pixels; JPEG cannot be longer, and a strip of one pixel is no photo
PICTURE_BYTES = 1 << 30  # of a file; larger ones are no photos

FILES = 20_000  # of an archive of photos
FRAME_PIXELS = 50_000_000  # of one frame of a video, of which decoders hold a dozen: 8K has 33 million
VIDEO_FRAMES = 250_000  # an hour at 60 a second; a walk round a piece of furniture takes one or two minutes

# Text
JSON = 64 << 20  # bytes; Pix3D's own file has 13 MB, and Python takes about ten times as much
CAMERAS = 512 << 20  # bytes of one file of a COLMAP model: millions of points

# Shapes
UNPACKED = 4 << 30  # bytes that an archive, or the arrays of a small file, may claim to unpack to
TEXT = 1 << 30  # bytes of a text file, or of the text in an archive
SCENE = 300 << 20  # bytes of a file that another program's reader takes whole: FBX, USD, DAE, 3MF
POINTS = 1_000_000  # of a larger cloud, this many are drawn while it is read
GAUSSIANS = 2_000_000  # the same for splats
FACES = 20_000_000  # of a mesh
SIDE = 2048  # voxels along one axis
CELLS = 256  # along one axis that are kept: the network sees 64
