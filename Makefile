# Aliases for those whose fingers type make.
demo test setup clean:
	./run $@
.PHONY: demo test setup clean
