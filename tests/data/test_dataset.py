def test_x(tiny_dataset, trained_run):
    import subprocess
    print(subprocess.run(["find", str(tiny_dataset.folder), str(trained_run)], capture_output=True, text=True).stdout)
    print((tiny_dataset.folder/"manifest.json").read_text()[:2500])
    print((trained_run/"metrics.jsonl").read_text())
