"""Validates TOML files with a JSON schema: validate.py SCHEMA FILE... Prints a line for each file."""

import json
import sys
import tomllib

import jsonschema

with open(sys.argv[1], encoding="utf-8") as file:
    schema = json.load(file)
jsonschema.Draft7Validator.check_schema(schema)
validator = jsonschema.Draft7Validator(schema)
for path in sys.argv[2:]:
    with open(path, "rb") as file:
        # Dates of TOML as the text that an editor passes.
        content = json.loads(json.dumps(tomllib.load(file), default=str))
    errors = [error.message for error in validator.iter_errors(content)]
    print("; ".join(errors) or "valid")
