//! No code: the manifest names features of libraries, so that every build of this workspace shares what is compiled.
