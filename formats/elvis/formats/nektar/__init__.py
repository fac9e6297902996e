"""The codecs of the native format, one part of it a module; `elvis.formats.read` and `write` put them together."""
