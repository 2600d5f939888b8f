def judge(case):
    return {}
