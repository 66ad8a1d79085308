"""What the doctor can find, with its meaning and what to do: the source of docs/troubleshooting.md."""

from __future__ import annotations

from neugrasp.doctor.findings import Problem

UNREADABLE = Problem(
    "A file cannot be read",
    "A photo or scene.json is missing, damaged, or holds something that is not what its key says.",
    "Mend the named file or entry; docs/data_format.md has the format",
)
NOT_RIGID = Problem(
    "A pose is no rigid transform",
    "world_from_camera must be a rotation (orthonormal, determinant +1) and a translation in metres. A "
    "scale, a shear, a mirrored axis or a matrix of another shape cannot be a camera.",
    "Write 4 x 4 matrices with a rotation at the upper left and [0, 0, 0, 1] as the last row",
)
TRANSPOSED = Problem(
    "Poses are transposed",
    "The translation stands in the last row: the matrices were written column by column.",
    "Transpose world_from_camera, or run `neugrasp doctor SCENE --fix OUT`",
)
OPENGL = Problem(
    "Cameras are OpenGL or Blender cameras",
    "With y up and a line of sight along -z every camera looks away from the table.",
    "Multiply world_from_camera by diag(1, -1, -1, 1) from the right, or run `neugrasp doctor SCENE --fix"
    " OUT`",
)
INVERTED = Problem(
    "Poses are camera_from_world",
    "The matrices map the world into the camera, as solvePnP and COLMAP give them; the inverse is wanted.",
    "Invert the matrices, or run `neugrasp doctor SCENE --fix OUT`",
)
INVERTED_OPENGL = Problem(
    "Poses are view matrices of OpenGL",
    "The matrices map the world into a camera with y up that looks along -z.",
    "Invert the matrices, then multiply by diag(1, -1, -1, 1) from the right, or run `neugrasp doctor "
    "SCENE --fix OUT`",
)
INVERTED_ROTATION = Problem(
    "Rotations are inverted, positions are not",
    "The positions are those of the cameras, but the rotations map the world into the camera.",
    "Transpose the 3 x 3 rotation, or run `neugrasp doctor SCENE --fix OUT`",
)
QUATERNION_ORDER = Problem(
    "Quaternions were read in another order",
    "ROS, SciPy and PyBullet write (x, y, z, w); Eigen, MuJoCo, Blender and COLMAP write (w, x, y, z).",
    "Make the matrices again with the other order, or run `neugrasp doctor SCENE --fix OUT`",
)
BODY_FRAME = Problem(
    "Cameras are ROS body frames",
    "The matrices have x forward, y left and z up; in ROS the frame that is wanted ends in _optical_frame.",
    "Give the pose of the optical frame, or run `neugrasp doctor SCENE --fix OUT`",
)
INVERTED_WORKSPACE = Problem(
    "The workspace is given inverted",
    "world_from_workspace holds workspace_from_world.",
    "Invert world_from_workspace, or run `neugrasp doctor SCENE --fix OUT`",
)
UNITS = Problem(
    "Lengths are not in metres",
    "Translations in millimetres or centimetres put the cameras far away from the table.",
    "Divide the translations as measured, or run `neugrasp doctor SCENE --fix OUT`",
)
CUBE_NOT_SEEN = Problem(
    "No camera sees the cube",
    "The poses, read in any convention and unit, do not look at the workspace.",
    "Check world_from_workspace (the lower corner of the cube, 0.05 m below the table), the poses and the"
    " intrinsics",
)
ONE_VIEW_MISSES = Problem(
    "A view does not see the cube",
    "It adds nothing to the prediction, and most often its pose is wrong.",
    "Check the pose of this view, or leave the view out",
)
CAMERA_BELOW_TABLE = Problem(
    "A camera stands below the table",
    "The z axis of the workspace must point up, away from the table.",
    "Check the direction of the z axis of world_from_workspace and the pose of the camera",
)
OTHER_RESOLUTION = Problem(
    "Intrinsics belong to another resolution",
    "Focal length and principal point are in pixels of the photo as it is on disk.",
    "Scale fx, fy, cx, cy to the size of the photos, or run `neugrasp doctor SCENE --fix OUT`",
)
INTRINSICS_UNIT = Problem(
    "Intrinsics are not in pixels",
    "Lens makers give focal lengths in millimetres, some programs fractions of the width.",
    "Give fx, fy, cx and cy in pixels: millimetres over the size of a pixel, or fractions times the size of "
    "the photo",
)
PRINCIPAL_POINT = Problem(
    "The principal point is far from the middle",
    "That is right only for cropped photos, and then the crop must be in the intrinsics.",
    "Check cx and cy, in pixels of the photo as it is on disk",
)
FIELD_OF_VIEW = Problem(
    "An unusual field of view",
    "Few cameras see less than 15 or more than 110 degrees; a fisheye lens is no pinhole camera.",
    "Check fx and fy, and undistort the photos of a wide lens",
)
UNEQUAL_FOCAL = Problem(
    "fx and fy differ",
    "Pixels of today's cameras are square; the photo was stretched, or one number is wrong.",
    "Check the intrinsics, and do not change the proportions of photos",
)
FOCAL_LENGTH = Problem(
    "The focal length does not fit the photos",
    "With another focal length the photos of the table agree with each other, with this one they do not.",
    "Calibrate the camera at the focus and the resolution of the capture",
)
ROTATION_TAG = Problem(
    "Photos carry a rotation tag",
    "Phones store turned photos with an EXIF tag. The pixels are read as they are stored; calibration "
    "programs differ.",
    "Store the photos upright without the tag (or `exiftran -ai`), and calibrate on the same files",
)
OTHER_LENS = Problem(
    "Photos were taken with another focal length",
    "Phones exchange lenses, and zoom, by themselves; a photo says in its EXIF tags at which focal length it "
    "was taken. At the double of the right focal length no grasp holds.",
    "Calibrate the camera at the lens and the zoom of the capture, and keep both from photo to photo",
)
MIRRORED = Problem(
    "Photos are mirrored",
    "Front cameras and some drivers mirror or turn the picture; no pose can make up for that.",
    "Switch the mirroring or turning off and take the photos again, or flip the files of the named views",
)
VIEW_ORDER = Problem(
    "Poses and photos are in different orders",
    "The photos agree about the table when their poses are exchanged.",
    "Give each photo its own pose (in the alphabet 10 comes before 2), or run `neugrasp doctor SCENE --fix "
    "OUT`",
)
TABLE_HEIGHT = Problem(
    "The table is not where the cube expects it",
    "The table plane must lie 0.05 m above the lower corner of the cube. At another height the photos agree.",
    "Shift world_from_workspace along its z axis as measured, or run `neugrasp doctor SCENE --fix OUT`",
)
TABLE_TILTED = Problem(
    "The table is tilted against the cube",
    "The floor of the cube must be parallel to the table: a board lay on something, or a calibration is off.",
    "Measure the workspace frame again, or run `neugrasp doctor SCENE --fix OUT`",
)
TABLE_OFFSET = Problem(
    "The photos disagree about the table",
    "Laid onto the table plane, the photos of the empty table do not coincide: poses, intrinsics or lens "
    "distortion are off. A polished table that mirrors the room looks like that, too.",
    "Calibrate again (intrinsics, hand-eye), undistort the photos, and check that each photo was taken at"
    " rest",
)
POSES_UNCHECKED = Problem(
    "Poses unchecked",
    "Only a pattern on the table tells to the millimetre whether the photos have it at the same place. On a "
    "plain one, errors of the poses are seen from silhouettes only, when grasps are far off already.",
    "Lay a patterned sheet or the board on the table once, take the backgrounds and run the doctor again",
)
SCALE_UNCHECKED = Problem(
    "Scale unchecked",
    "A world that is larger by a factor, seen from as many times further away, looks the same: where all "
    "poses and the cube's place are off by 5 %, as after a print that is not in its true size, so are "
    "grasps, by 5 % of their distance from the world's origin.",
    "Measure once: what is 30 cm long on the table must be as long as the cube's edge in the report's photos",
    is_universal=True,
)
SILHOUETTES = Problem(
    "The silhouettes contradict each other",
    "What changed in one photo would have to stand where another photo shows the empty table: poses, "
    "intrinsics or the cube's place are off, or backgrounds belong to other views.",
    "Check the hand-eye calibration, the intrinsics, and that each background belongs to its photo",
)
LITTLE_SEEN = Problem(
    "The photos cut the cube off",
    "What fewer than two views see cannot be reconstructed.",
    "Move the cameras back, or aim at the middle of the cube",
)
SMALL_IN_PHOTO = Problem(
    "The cube is small in the photos",
    "The network reads 256 pixels across the cube; fewer are enlarged.",
    "Go nearer, use a longer lens, or take larger photos",
)
NO_BASELINE = Problem(
    "The cameras are too close together",
    "Depth comes from looking at the same thing from different directions.",
    "Spread the views over at least 20 degrees about the middle of the table",
)
SAME_PLACE = Problem(
    "Two views are the same",
    "The second one adds nothing.",
    "Take each photo from another place, or leave one view out",
)
UNTRAINED_ANGLE = Problem(
    "A camera looks from an angle that no training showed",
    "The shipped weights know views from 10 to 50 degrees off the vertical.",
    "Look more steeply down at the table",
)
UNTRAINED_DISTANCE = Problem(
    "A camera is very near or very far",
    "The shipped weights know cameras 0.4 to 0.5 m from the table; 0.25 to 1.2 m works alike.",
    "Move the camera, or check the units of the poses",
)
SINGLE_VIEW = Problem(
    "There is one view only",
    "One photo leaves the depth open; the network has to guess it.",
    "Take four photos",
)
SAME_PHOTO = Problem(
    "The background is the photo itself",
    "Image and background are equal pixel by pixel, so nothing seems to stand on the table.",
    "Give the photo of the empty table as background",
)
EXCHANGED = Problem(
    "Images and backgrounds are exchanged",
    "The backgrounds show objects and the images an empty table.",
    "Exchange the entries image and background, or run `neugrasp doctor SCENE --fix OUT`",
)
SWAPPED = Problem(
    "Backgrounds belong to other views",
    "An image fits the background of another view.",
    "Give each image the background from the same camera, or run `neugrasp doctor SCENE --fix OUT`",
)
BACKGROUND_DIFFERS = Problem(
    "A background does not fit its image",
    "The table's texture cannot be brought to cover: the camera moved far, or it is another table.",
    "Take image and background from exactly the same place",
)
NOT_EMPTY = Problem(
    "Something stands on the empty table",
    "What is in the background, too, is taken for the table: it gets no surface, and grasps may hit it.",
    "Clear the table, and take the backgrounds again",
)
SHIFTED = Problem(
    "The camera moved between image and background",
    "The network looks at the difference of the two; shifted edges look like objects.",
    "Fix the camera, let the robot come to rest, lock focus and stabilisation, and take both photos again",
)
EXPOSURE = Problem(
    "Exposure changed between image and background",
    "Automatic exposure makes the whole table look changed.",
    "Lock exposure and gain for all photos",
)
WHITE_BALANCE = Problem(
    "White balance changed between image and background",
    "Automatic white balance makes the whole table look changed.",
    "Lock the white balance for all photos",
)
LIGHT_MOVED = Problem(
    "The light changed between image and background",
    "One side of the table became brighter than the other: a lamp was moved, the sun went on, somebody "
    "cast a shadow.",
    "Take both photos in the same light, shortly after each other",
)
CHANGED_OUTSIDE = Problem(
    "Something changed around the workspace",
    "A hand, a cable or a moved box beside the cube; its shadow and reflection fall into it.",
    "Clear the surroundings, or leave them alone between the two photos",
)
NOTHING_THERE = Problem(
    "Nothing stands in the cube",
    "Image and background show the same inside the cube.",
    "Check the place of the cube in the report, and that the images show the objects",
)
BLURRED = Problem(
    "A photo is blurred",
    "Motion or focus; fine edges carry the depth.",
    "Take the photo at rest, in focus, with more light",
)
SATURATED = Problem(
    "Parts of a photo are white",
    "Where a photo is saturated, nothing can be compared.",
    "Expose less, or move the lamp whose reflection it is",
)
DARK = Problem(
    "A photo is dark",
    "What is black holds noise and no edges.",
    "Expose longer, or add light",
)


def all_problems() -> list[Problem]:
    """In the order in which they are written down."""
    return [value for value in globals().values() if isinstance(value, Problem)]
