"""Studies: questions about a method that one run answers, each a `[study.NAME]` table of a scene."""
