"""Reports of upscaling studies, apart from the mathematics."""
