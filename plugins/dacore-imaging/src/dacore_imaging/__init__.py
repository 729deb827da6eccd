"""Measurements of medical imaging, and the brain, for dacore."""

from dacore.plugins import PluginSpec, hookimpl


@hookimpl
def dacore_domains() -> list[PluginSpec]:
    """Declare the brain."""
    return [
        PluginSpec(
            "brain",
            "dacore_imaging.brain:Brain",
            requires=("nibabel", "nilearn"),
            install="pip install nibabel nilearn",
            summary="the MNI152 brain with its ventricles",
        )
    ]


@hookimpl
def dacore_observations() -> list[PluginSpec]:
    """Declare what can be measured."""
    return [
        PluginSpec("voxels", "dacore_imaging.voxels:Voxels", summary="averages over image voxels, exact"),
        PluginSpec(
            "image",
            "dacore_imaging.image:Image",
            requires=("nibabel",),
            install="pip install nibabel",
            summary="averages over the voxels of a NIfTI image's own grid, exact",
        ),
        PluginSpec("points", "dacore_imaging.points:PointSensors", summary="point sensors: value, derivative, kernel"),
    ]


@hookimpl
def dacore_formats() -> list[PluginSpec]:
    """Declare what data can be read from."""
    return [
        PluginSpec(
            "nifti",
            "dacore_imaging.nifti:Nifti",
            requires=("nibabel",),
            install="pip install nibabel",
            summary="displacement images, one file a component or 4-D and 5-D, real or complex",
        )
    ]


@hookimpl
def dacore_quantities() -> list[PluginSpec]:
    """Declare numbers of interest."""
    return [
        PluginSpec(
            "boundary_mean",
            "dacore_imaging.quantities:BoundaryMean",
            summary="mean of a field over a boundary, e.g. the ventricular pressure",
        ),
        PluginSpec(
            "volume_mean",
            "dacore_imaging.quantities:VolumeMean",
            summary="mean of a field over the whole domain",
        ),
    ]
