"""Rules files: the parts of the document, a codec for each learner, and reading and writing whole files."""
