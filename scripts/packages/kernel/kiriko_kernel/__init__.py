"""The compiled kernel of Kiriko: a shared library that kiriko-optics loads."""
